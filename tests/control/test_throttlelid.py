"""The pilot's throttle caps ours: the daemon notices by what the FlightCtrl says it flies with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lab.control.corerig import CoreRig, stamp
from lab.control.flights import Flight
from mkdaemon.control.actions import PublishStatus, Warn
from mkdaemon.control.throttlelid import LASTING, ThrottleLid
from mkdaemon.control.vehicle import ThrottleReport
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.state import Pilot
from mksim.config import WindClass

PERIOD = 0.02
LID = -14.0
"""The pilot's stick [stick]: about nine tenths of the thrust that hovers."""


def told(lid, throttle, in_use, seconds, *, every=0.1, start=0.0):
    """Frames of one throttle, and reports of what is flown with."""
    report = None
    for step in range(round(seconds / PERIOD)):
        now = start + step * PERIOD
        if in_use is not None and step % round(every / PERIOD) == 0:
            report = ThrottleReport(in_use, now)
        lid.frame_made(throttle, report, now)
    return start + seconds


def test_less_than_every_frame_asked_for_is_the_pilots_throttle_once_it_lasts():
    lid = ThrottleLid()
    now = told(lid, 5.0, 5.0, 1.0)
    assert lid.pilots_throttle is None
    now = told(lid, 5.0, -20.0, LASTING, start=now)
    assert lid.pilots_throttle is None
    now = told(lid, 5.0, -20.0, 0.2, start=now)
    assert lid.pilots_throttle == -20.0
    told(lid, 5.0, 4.0, 0.2, start=now)
    assert lid.pilots_throttle is None


def test_a_throttle_that_rises_is_not_taken_for_a_lid():
    lid = ThrottleLid()
    now = told(lid, -30.0, -30.0, 1.0)
    for step in range(20):
        now = told(lid, -30.0 + 2 * step, -30.0 + 2 * step - 8.0, 0.1, start=now)
        assert lid.pilots_throttle is None, "the FlightCtrl is 80 ms behind"


def test_without_reports_and_with_another_flight_nothing_is_known():
    lid = ThrottleLid()
    now = told(lid, 5.0, None, 2.0)
    assert lid.pilots_throttle is None
    now = told(lid, 5.0, -20.0, 2.0, start=now)
    assert lid.pilots_throttle == -20.0
    lid.frame_made(5.0, ThrottleReport(-20.0, now), now + 5.0)
    assert lid.pilots_throttle is None


class Capped(CoreRig):
    """The pilot's throttle is a lid from 4 to 5.5 s; the FlightCtrl reports what it flies with five times a second."""

    def _sticks(self):
        sticks = super()._sticks()
        self.in_use = min(sticks.gas, LID + 127.0) if 4.0 <= self._world.now < 5.5 else sticks.gas
        return replace(sticks, gas=self.in_use)

    def _report(self, at):
        super()._report(at)
        if round(at / PERIOD) % 10 == 0:
            self._at(at + 0.03, lambda now, gas=self.in_use: self.core.state_received(reported(now, gas), now))


def reported(at, gas):
    return Pilot(
        stamp=stamp(at),
        source="nc/osd",
        rc_quality=1.0,
        has_signal=True,
        throttle=None,
        sticks=None,
        throttle_in_use=gas - 127.0,
    )


def test_a_pilot_who_holds_his_throttle_too_low_is_noticed_and_the_flight_goes_on_when_he_raises_it():
    rig = Capped(Flight(seed=4, wind=WindClass.INDOOR, seconds=9.0))
    record = rig.fly()
    assert record.lost == ""
    shown = [(at, action.pilots_throttle) for at, action in rig.actions if isinstance(action, PublishStatus)]
    capped = [at for at, lid in shown if lid is not None]
    assert 4.4 < capped[0] < 5.0
    assert {lid for _, lid in shown} == {None, LID}
    assert 5.5 < next(at for at, lid in shown if lid is None and at > capped[0]) < 6.1
    [warning] = [action.text for _, action in rig.actions if isinstance(action, Warn)]
    assert warning.startswith("the pilot's throttle (-14) caps ours: the aircraft sinks")
    heights = np.array(record.positions)[:, 2]
    times = np.array(record.times)
    assert heights[(times > 5.0) & (times < 6.2)].min() < 1.7, "nothing could be done"
    assert heights[-1] > 1.85
    assert rig.core.phase is Phase.FLYING

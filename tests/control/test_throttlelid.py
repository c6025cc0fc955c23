"""The pilot's throttle caps ours: the daemon notices by what the FlightCtrl says it flies with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.control.corerig import stamp
from lab.control.flights import Flight
from mkdaemon.control.actions import PublishStatus, SendSticks, Warn
from mkdaemon.control.estimator.values import GAS_CENTRE, OURS, ThrottleUse
from mkdaemon.control.events import StateValue
from mkdaemon.control.regulator.autopilot import LEAP, at_origin
from mkdaemon.control.throttlelid import LEAST_SHARE, ThrottleLid
from mkdaemon.control.vehicle import FRESH, ThrottleReport
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.state import Pilot
from mksim.config import WindClass
from tests.control.coreflights import Told
from tests.values import made

PERIOD = 0.02
LID = -14.0
"""The pilot's stick [stick]: about nine tenths of the thrust that hovers."""


def told(lid, throttle, in_use, seconds, *, every=0.1, start=0.0):
    """Frames of one throttle, and reports of what is flown with."""
    report = None
    for step in range(round(seconds / PERIOD)):
        now = start + step * PERIOD
        if in_use is not None and step % round(every / PERIOD) == 0:
            report = in_use._replace(at=now) if isinstance(in_use, ThrottleReport) else ThrottleReport(in_use, now)
        lid.frame_made(throttle, report, now)
    return start + seconds


@pytest.fixture
def lid():
    return ThrottleLid()


@pytest.mark.parametrize(("throttle", "is_told"), [(-67.0, True), (-68.0, False), (-100.0, False)])
def test_under_a_throttle_that_carries_no_aircraft_nothing_is_told(lid, throttle, is_told):
    """Genuine numbers after a touch: 27 counts asked for, 18 flown, as the pilot's stick is at its lowest."""
    now = told(lid, throttle, throttle, 1.0)
    told(lid, throttle, throttle - 9.0, 1.0, start=now)
    assert (lid.pilots_throttle is not None) is is_told


def test_a_throttle_that_rises_is_not_taken_for_a_lid(lid):
    now = told(lid, -30.0, -30.0, 1.0)
    for step in range(20):
        now = told(lid, -30.0 + 2 * step, -30.0 + 2 * step - 8.0, 0.1, start=now)
        assert lid.pilots_throttle is None, "the FlightCtrl is 80 ms behind"


@pytest.mark.parametrize("scale", [0.76, 0.87, 1.0])
def test_a_board_that_reports_after_the_compensation_of_its_voltage_has_no_lid_but_a_scale(lid, scale):
    now = told(lid, 0.0, scale * 127.0 - 127.0, 1.0)
    assert lid.use == OURS
    now = told(lid, 30.0, scale * 157.0 - 127.0, 1.0, start=now)
    assert lid.use == OURS, "what is reported follows ours"
    told(lid, 60.0, scale * 157.0 - 127.0, 1.5, start=now)
    assert lid.use.cap == pytest.approx(157.0), "no longer: in our own counts"


def test_a_lid_that_lies_there_from_the_start_is_no_scale_also_without_a_voltage():
    """9 of 130 counts were taken for the share that the compensation leaves."""
    lid = ThrottleLid()
    told(lid, 3.0, -118.0, 1.5)
    assert lid.use.cap == pytest.approx(9.0 / LEAST_SHARE)


@pytest.mark.parametrize("cells", [3, 4])
@pytest.mark.parametrize("cell", [3.2, 3.4, 3.7, 3.9, 4.1, 4.2])
def test_at_no_voltage_is_compensation_a_lid_and_a_real_lid_is_seen_from_the_start(cell, cells):
    def reported(stick):
        count = int(stick + 127.0) * round(32 * cells) // int(10.0 * cell * cells + 1e-9)
        return ThrottleReport(float(count) - 127.0, 0.0, min(1.0, 3.2 / cell))

    lid, now = ThrottleLid(), 0.0
    for stick in (-2.0, 30.0, -20.0, -2.0):
        now = told(lid, stick, reported(stick), 1.0, start=now)
        assert (lid.pilots_throttle, lid.use) == (None, OURS)
    now = told(lid, 10.0, reported(-20.0), 1.0, start=now)
    assert lid.pilots_throttle == pytest.approx(-20.0, abs=2.0), "in the counts of a stick"
    assert lid.use.cap == pytest.approx(107.0, abs=2.0)
    told(lid, 10.0, reported(-20.0), 1.0, start=now + 5.0)
    assert lid.pilots_throttle == pytest.approx(-20.0, abs=2.0), "another flight that begins under it"


def test_once_reports_end_nothing_confirms_that_ours_acts_and_another_flight_begins_anew(lid):
    now = told(lid, 0.0, 0.0, 1.0)
    now = told(lid, 0.0, None, FRESH - 0.2, start=now)
    assert lid.use == OURS
    now = told(lid, 0.0, None, 0.5, start=now)
    assert lid.use == ThrottleUse(None, is_ours=False)
    told(lid, 0.0, None, 0.5, start=now + 5.0)
    assert lid.use == OURS


class Capped(Told):
    """The pilot's throttle is a lid for a while; the FlightCtrl reports what it flies with five times a second."""

    lid, begins, ends, scale = LID, 4.0, 5.5, 1.0

    def _sticks(self):
        sticks = super()._sticks()
        is_capped = self.begins <= self._world.now < self.ends
        self.in_use = min(sticks.gas, self.lid + 127.0) if is_capped else sticks.gas
        return replace(sticks, gas=self.in_use)

    def _report(self, at):
        super()._report(at)
        gas = round(self.scale * self.in_use)
        if round(at / PERIOD) % 10 == 0:
            self._at(at + 0.03, lambda now: self.core.feed(StateValue(reported(now, gas)), now))


class Pinned(Capped):
    """The lid just carries the aircraft, which is to climb by a metre."""

    lid, begins, ends = -1.0, 4.0, 11.0

    def __init__(self, flight):
        super().__init__(flight)
        self.known, self.was_known = set(), False

    def _control(self, at):
        if self.was_known:
            self.known.add(at)
        super()._control(at)
        self.was_known = self.core._output.lid.use.cap is not None

    def sent(self, start, end):
        """Throttles that were made when the lid was known: it takes 0.4 s to know one."""
        return [action.counts.throttle for at, action in self.of(SendSticks, start, end) if at in self.known]


def test_no_throttle_winds_up_under_a_lid_and_none_leaps_when_the_pilot_raises_it():
    """Nor where the FlightCtrl reports less than it flies with, and the lid is known to a tenth only."""
    scale, known_to = 0.87, 0.1 * GAS_CENTRE
    rig = Pinned(Flight(seed=4, wind=WindClass.INDOOR, seconds=15.0, goal=lambda t: at_origin(2.0 if t < 3.0 else 3.0)))
    rig.scale = scale
    record = rig.fly()
    assert record.lost == ""
    hover = [value.hover_throttle for value in rig.estimates]
    assert max(hover) < hover[150] + 5.0, "it is the same aircraft as before the lid"
    times, heights = np.array(record.times), np.array(record.positions)[:, 2]
    assert max(rig.sent(5.5, 11.0)) <= max(rig.lid, max(hover)) + LEAP + known_to + 1.0
    climb = np.diff(heights)[times[1:] > 11.0] / PERIOD
    assert climb.max() < 0.7, "it climbs as it always does"
    assert heights[-1] == pytest.approx(3.0, abs=0.15)


def reported(at, gas):
    return made(Pilot, stamp(at), rc_quality=1.0, has_signal=True, throttle_in_use=gas - 127.0)


def test_a_pilot_who_holds_his_throttle_too_low_is_noticed_and_the_flight_goes_on_when_he_raises_it():
    rig = Capped(Flight(seed=4, wind=WindClass.INDOOR, seconds=9.0))
    record = rig.fly()
    assert record.lost == ""
    shown = [(at, action.pilots_throttle) for at, action in rig.of(PublishStatus)]
    capped = [at for at, lid in shown if lid is not None]
    assert 4.4 < capped[0] < 5.0
    assert {lid for _, lid in shown} == {None, LID}
    assert 5.5 < next(at for at, lid in shown if lid is None and at > capped[0]) < 6.1
    [(_, warning)] = rig.of(Warn)
    assert warning.text.startswith("the pilot's throttle (-14) caps ours: the aircraft sinks")
    heights = np.array(record.positions)[:, 2]
    times = np.array(record.times)
    assert heights[(times > 5.0) & (times < 6.2)].min() < 1.7, "nothing could be done"
    assert heights[-1] > 1.8
    assert rig.core.phase is Phase.FLYING


def compared(frames, reports, *, share=1.0):
    """What is known after frames (moment, throttle) and reports (moment, throttle), in the order of their moments."""
    lid = ThrottleLid()
    report = None
    for at, throttle in frames:
        report = next((ThrottleReport(said, when, share) for when, said in reversed(reports) if when <= at), report)
        lid.frame_made(throttle, report, at)
    return lid


def steady(throttle, seconds, start=0.0):
    return [(start + 0.0625 * k, throttle) for k in range(round(seconds / 0.0625) + 1)]


@pytest.mark.parametrize(
    ("usual", "other", "when", "flown", "is_ours"),
    [
        # Six counts less than the lowest of half a second, and six more than the highest.
        (30.0, 10.0, 0.5, 4.0, True),
        (30.0, 10.0, 0.5, 3.75, False),
        (10.0, 30.0, 0.5, 36.0, True),
        (10.0, 30.0, 0.5, 36.1, False),
        # The half second before the report.
        (10.0, -30.0, 0.4375, -30.0, False),
        (10.0, -30.0, 0.5, -30.0, True),
        (10.0, -30.0, 1.0, -30.0, True),
        (10.0, -30.0, 1.0625, -30.0, False),
    ],
)
def test_what_is_near_a_frame_of_the_half_second_before_may_be_ours(usual, other, when, flown, is_ours):
    frames = [(at, other if at == when else usual) for at, _ in steady(0.0, 1.0625)]
    assert compared(frames, [(1.0, flown)]).use == ThrottleUse(None, is_ours=is_ours)


@pytest.mark.parametrize(("flown", "is_capped"), [(4.0, False), (3.75, True)])
def test_what_stays_below_is_the_pilots_until_ours_is_flown_again(flown, is_capped):
    lid = compared(steady(10.0, 2.0), [(at, flown) for at, _ in steady(0.0, 2.0)])
    assert (lid.use.cap, lid.pilots_throttle) == ((flown + 127.0, flown) if is_capped else (None, None))
    for at in (2.0625, 2.125, 2.1875):
        lid.frame_made(10.0, ThrottleReport(9.0, at), at)
    assert (lid.use, lid.pilots_throttle) == (OURS, None), "what is asked for is flown again"


def test_before_half_a_second_of_frames_nothing_is_compared():
    assert compared(steady(10.0, 0.4375), [(0.4375, -50.0)]).use == OURS
    assert compared(steady(10.0, 0.5), [(0.5, -50.0)]).use == ThrottleUse(None, is_ours=False)


@pytest.mark.parametrize(("lasts", "is_sure"), [(0.375, False), (0.4375, True)])
def test_a_lid_is_sure_after_four_tenths_of_a_second(lasts, is_sure):
    reports = [(at, 10.0 if at < 1.0 else -20.0) for at, _ in steady(0.0, 1.0 + lasts)]
    lid = compared(steady(10.0, 1.0 + lasts), reports)
    assert (lid.use.cap is not None) is is_sure
    assert (lid.pilots_throttle is not None) is is_sure
    again = compared(steady(10.0, 2.0), [(at, -20.0 if at != 1.75 else 10.0) for at, _ in steady(0.0, 2.0)])
    assert again.use.cap is None, "it begins anew where ours was flown between"


def test_a_report_counts_once():
    frames = steady(10.0, 3.0)
    lid = compared(frames, [(1.0, -20.0)])
    assert lid.use == ThrottleUse(None, is_ours=False)
    assert lid.pilots_throttle is None, "nothing has lasted"


@pytest.mark.parametrize(("silence", "is_known"), [(0.5, True), (0.5625, False)])
def test_a_pause_of_half_a_second_is_another_flight(silence, is_known):
    lid = compared(steady(10.0, 2.0), [(at, -20.0) for at, _ in steady(0.0, 2.0)])
    assert lid.use.cap == pytest.approx(107.0)
    lid.frame_made(10.0, None, 2.0 + silence)
    assert (lid.use.cap is not None) is is_known
    assert (lid.pilots_throttle is not None) is is_known


@pytest.mark.parametrize(("share", "stick", "is_stick"), [(0.8, 10.0, True), (0.97, 10.0, False), (0.8, -100.0, False)])
def test_a_board_that_reports_its_stick_is_known_where_that_differs_by_more_than_six_counts(share, stick, is_stick):
    """A fifth of 137 counts is 27; three hundredths are 4, and a fifth of 27 is 5."""
    lid = compared(steady(stick, 1.0), [(at, stick) for at, _ in steady(0.0, 1.0)], share=share)
    assert lid._scale == (1.0 if is_stick else share)
    assert lid.use.is_ours
    if is_stick:
        for k in range(1, 20):
            at = 1.0 + 0.0625 * k
            lid.frame_made(stick + 20.0, ThrottleReport(stick, at, share), at)
        assert (lid.pilots_throttle, lid.use.cap) == (stick, pytest.approx(stick + 127.0))


@pytest.mark.parametrize(("above", "is_stick"), [(5.9, False), (6.1, True)])
def test_more_than_the_share_of_the_highest_frame_is_a_stick(above, is_stick):
    flown = 0.8 * 157.0 - 127.0 + above
    frames = [(at, 30.0 if at == 0.5 else 10.0) for at, _ in steady(0.0, 1.0)]
    lid = compared(frames, [(1.0, flown)], share=0.8)
    assert lid._scale == (1.0 if is_stick else 0.8)


def test_without_a_voltage_the_largest_share_of_this_flight_counts():
    lid = compared(steady(10.0, 1.0), [(at, 0.7 * 137.0 - 127.0) for at, _ in steady(0.0, 1.0)], share=None)
    assert lid._scale == pytest.approx(0.7)
    for k in range(1, 20):
        lid.frame_made(10.0, ThrottleReport(0.5 * 137.0 - 127.0, 1.0 + 0.0625 * k), 1.0 + 0.0625 * k)
    assert lid._scale == pytest.approx(0.7)
    assert lid.use.cap == pytest.approx(0.5 * 137.0 / 0.7)
    assert lid.pilots_throttle == pytest.approx(0.5 * 137.0 - 127.0), "what is shown is as it was told"
    lid.frame_made(10.0, ThrottleReport(60.0, 2.25), 2.25)
    assert lid._scale == 1.0, "no share is more than all"


def test_a_throttle_that_the_motors_least_hides_does_not_tell_what_is_reported(lid):
    """A stick of 8 counts is flown as 20, the least of the motors; at 125 counts four fifths are reported, as said."""
    now = told(lid, 8.0 - GAS_CENTRE, ThrottleReport(20.0 - GAS_CENTRE, 0.0, 0.8), 1.0)
    told(lid, 125.0 - GAS_CENTRE, ThrottleReport(100.0 - GAS_CENTRE, 0.0, 0.8), 1.5, start=now)
    assert lid.use == OURS

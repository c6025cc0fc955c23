"""Attitude setpoints under the lease: entry, flight, age, epoch, limiter; the whole core decides, in virtual time."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from lab.control.corerig import CoreRig
from lab.control.flights import Flight
from mkdaemon.control.actions import PublishEstimate, PublishStatus, ReleaseAircraft, ReportMode, SendSticks
from mkdaemon.control.events import SetpointAccepted
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import AttitudeSetpoint
from mksim.config import WindClass

CALM = Flight(seed=4, wind=WindClass.NONE, seconds=5.5, start=3.0)
LEVEL = {"roll": 0.0, "pitch": 0.0, "yaw_rate": 0.0, "thrust": 1.0}
LEAN = math.radians(6.0)
HEADING = 0.3
"""Of the aircraft at the start of every flight of the rig [rad]."""


class Leans(CoreRig):
    """Streams a level attitude, from 3 s on another one, and nothing after a while; poses come or not."""

    def __init__(self, flight, *, until=math.inf, sees=True, **wanted):
        super().__init__(flight)
        self.wanted, self.until, self.sees = LEVEL | wanted, until, sees

    def _see(self, view, at):
        if self.sees:
            super()._see(view, at)
        else:
            self._show_pilot(view, at)

    def _control(self, at):
        if at >= self.until:
            self.is_silent = True
        super()._control(at)

    def _setpoint(self, goal, at):
        fields = self.wanted if at >= 3.0 else LEVEL
        return AttitudeSetpoint(epoch=self._epoch, sequence=self._sequence, ttl=0.3, **fields)

    def counts(self, start, end=math.inf):
        """Sticks that left between two times."""
        return [action.counts for at, action in self.actions if isinstance(action, SendSticks) and start <= at < end]

    def began(self):
        return next(at for at, a in self.actions if isinstance(a, ReportMode) and a.after is Phase.FLYING)


def turned(rig, seconds):
    """How the position changed between 3 s and so long after, forward, left, up [m]."""
    places, times = np.array(rig.record.positions), np.array(rig.record.times)
    first, last = places[times >= 3.0][0], places[times >= 3.0 + seconds][0]
    x, y, z = last - first
    return x * math.cos(HEADING) + y * math.sin(HEADING), y * math.cos(HEADING) - x * math.sin(HEADING), z


@cache
def level():
    """A flight that stays level; nobody changes it."""
    rig = Leans(CALM, sees=False)
    assert rig.fly().lost == ""
    return rig


def drift(seconds):
    """How a level attitude drifts: accelerometers are mounted with an error."""
    return turned(level(), seconds)


@pytest.mark.parametrize("sees", [True, False])
def test_a_level_attitude_begins_a_flight_after_a_second_with_and_without_a_target(sees):
    rig = Leans(CALM) if sees else level()
    if sees:
        assert rig.fly().lost == ""
    assert rig.began() == pytest.approx(rig.cfg.lease.engage_after, abs=0.1)
    status = [action for _, action in rig.actions if isinstance(action, PublishStatus)][-1]
    assert (status.phase, status.manoeuvre) == (Phase.FLYING, "attitude")
    assert any(isinstance(action, PublishEstimate) for _, action in rig.actions) is sees


@pytest.mark.parametrize(
    ("lean", "axis", "sign"),
    [({"pitch": LEAN}, 0, 1.0), ({"pitch": -LEAN}, 0, -1.0), ({"roll": LEAN}, 1, -1.0), ({"roll": -LEAN}, 1, 1.0)],
)
def test_an_attitude_leans_the_aircraft_the_way_it_says(lean, axis, sign):
    rig = Leans(CALM, sees=False, **lean)
    assert rig.fly().lost == ""
    way = np.subtract(turned(rig, 2.0), drift(2.0))
    assert 0.8 < sign * way[axis] < 3.0, "6 degrees are 1 m/s2, and more with the leak"
    assert abs(way[1 - axis]) < 0.35 * abs(way[axis])
    asked = math.degrees(LEAN) / math.degrees(rig.core._sight.model.rad_per_count)
    [largest] = {max(max(abs(c.pitch), abs(c.roll)) for c in rig.counts(3.5))}
    assert largest == round(asked)


def test_thrust_is_a_share_of_the_weight_and_a_yaw_rate_turns():
    rig = Leans(CALM, sees=False, thrust=1.08)
    assert rig.fly().lost == ""
    assert turned(rig, 1.5)[2] - drift(1.5)[2] > 0.3
    turns = Leans(replace(CALM, start=6.0), yaw_rate=0.3)
    turns.fly()
    assert 0.3 < turns.estimates[-1].yaw - next(e.yaw for e in turns.estimates) < 1.2


def test_an_attitude_that_is_too_old_gives_neutral_sticks_and_then_a_release_never_a_frozen_tilt():
    rig = Leans(CALM, sees=False, until=4.0, pitch=LEAN)
    rig.fly()
    ttl, after = rig.cfg.limiter.setpoint_ttl, rig.cfg.lease.release_after
    assert {c.pitch for c in rig.counts(4.0 + ttl + 0.03, 4.0 + after)} == {0}
    released = next(at for at, action in rig.actions if isinstance(action, ReleaseAircraft))
    assert released == pytest.approx(4.0 + after, abs=0.1)


def test_an_attitude_begins_no_flight_while_it_leans_and_reaches_no_wire_under_an_old_epoch():
    rig = Leans(CALM, sees=False, pitch=LEAN)
    rig._setpoint = lambda goal, at: AttitudeSetpoint(
        epoch=rig._epoch, sequence=rig._sequence, ttl=0.3, **(LEVEL | {"pitch": LEAN})
    )
    rig.fly()
    assert rig.counts(0.0) == []
    status = [action for _, action in rig.actions if isinstance(action, PublishStatus)][-1]
    assert status.reason.endswith("waiting for a level attitude")
    old = AttitudeSetpoint(epoch=rig._epoch - 1, sequence=9999, ttl=0.3, **LEVEL)
    refused = rig.core.feed(SetpointAccepted(old, rig._epoch), 6.0).refusal
    assert refused.token == "wrong_epoch"


def test_the_limiter_bounds_tilt_and_its_rate_of_change():
    rig = Leans(CALM, sees=False, until=3.5, pitch=math.radians(44.0), yaw_rate=3.0)
    rig.fly()
    sent = [(at, a) for at, a in rig.actions if isinstance(a, SendSticks) and 2.9 < at < 3.3]
    limits = rig.cfg.limiter
    assert max(a.counts.pitch for _, a in sent) == limits.max_pitch
    assert max(a.counts.yaw for _, a in sent) <= limits.max_yaw
    steps = [(b.counts.pitch - a.counts.pitch) / (t - s) for (s, a), (t, b) in pairwise(sent)]
    assert max(steps) <= limits.slew * 1.2
    assert all(a.is_limited for at, a in sent if at > 3.05)

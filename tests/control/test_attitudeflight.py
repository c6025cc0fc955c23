"""Attitude setpoints under the lease: entry, flight, age, epoch, limiter; the whole core decides, in virtual time."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lab.control.flights import Flight
from mkdaemon.control.actions import PublishEstimate, ReleaseAircraft, ReportMode, SendSticks
from mkdaemon.control.events import SetpointAccepted
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import AttitudeSetpoint
from mksim.config import WindClass
from tests.control.coreflights import Plan

CALM = Flight(seed=4, wind=WindClass.NONE, seconds=5.5, start=3.0)
LEVEL = {"roll": 0.0, "pitch": 0.0, "yaw_rate": 0.0, "thrust": 1.0}
LEAN = math.radians(6.0)
HEADING = 0.3
"""Of the aircraft at the start of every flight of the rig [rad]."""
SILENT = 5.1
"""From then on the client of a flight that leans says nothing [s]."""


class Leans(Plan):
    """Streams a level attitude, from 3 s on another one, and nothing after a while; poses come or not."""

    def __init__(self, flight, *, until=math.inf, sees=True, leans=3.0, **wanted):
        super().__init__(flight, (0.0, AttitudeSetpoint, LEVEL), (leans, AttitudeSetpoint, LEVEL | wanted))
        self.until, self.sees = until, sees

    def _see(self, view, at):
        if self.sees:
            super()._see(view, at)
        else:
            self._show_pilot(view, at)

    def _control(self, at):
        if at >= self.until:
            self.is_silent = True
        super()._control(at)


def turned(rig, seconds):
    """How the position changed between 3 s and so long after, forward, left, up [m]."""
    places, times = np.array(rig.record.positions), np.array(rig.record.times)
    first, last = places[times >= 3.0][0], places[times >= 3.0 + seconds][0]
    x, y, z = last - first
    return x * math.cos(HEADING) + y * math.sin(HEADING), y * math.cos(HEADING) - x * math.sin(HEADING), z


@pytest.fixture(scope="module")
def level():
    """A flight that stays level, by no image; nobody changes it, nor the others."""
    return flown(Leans(CALM, sees=False))


@pytest.fixture(scope="module")
def turning():
    """A flight over a target that turns on the spot."""
    return flown(Leans(replace(CALM, start=6.0), yaw_rate=0.3))


@pytest.fixture(scope="module")
def leaning():
    """A flight that leans forward and half as much to the right, until the client falls silent."""
    return flown(Leans(replace(CALM, seconds=SILENT + 1.5), sees=False, until=SILENT, pitch=LEAN, roll=LEAN / 2.0))


def flown(rig):
    assert rig.fly().lost == ""
    return rig


@pytest.mark.parametrize(("flight", "sees"), [("turning", True), ("level", False)])
def test_a_level_attitude_begins_a_flight_after_a_second_with_and_without_a_target(flight, sees, request):
    rig = request.getfixturevalue(flight)
    began, _ = rig.first(ReportMode, after=Phase.FLYING)
    assert began == pytest.approx(rig.cfg.lease.engage_after, abs=0.1)
    assert (rig.status.phase, rig.status.manoeuvre) == (Phase.FLYING, "attitude")
    assert bool(rig.of(PublishEstimate)) is sees


def test_an_attitude_leans_the_aircraft_the_way_it_says(leaning, level):
    forward, left, _ = np.subtract(turned(leaning, 2.0), turned(level, 2.0))
    assert 0.8 < forward < 3.0, "6 degrees are 1 m/s2, and more with the leak"
    assert -left == pytest.approx(0.5 * forward, abs=0.2 * forward)
    asked = math.degrees(LEAN) / math.degrees(leaning.core._sight.model.rad_per_count)
    counts = leaning.counts(3.5, SILENT)
    assert max(c.pitch for c in counts) == round(asked)
    assert max(abs(c.roll) for c in counts) == pytest.approx(asked / 2.0, abs=0.51)


def test_thrust_is_a_share_of_the_weight_and_a_yaw_rate_turns(turning, level):
    rises = flown(Leans(replace(CALM, seconds=4.6), sees=False, thrust=1.08))
    assert turned(rises, 1.5)[2] - turned(level, 1.5)[2] > 0.3
    assert 0.3 < turning.estimates[-1].yaw - next(e.yaw for e in turning.estimates) < 1.2


def test_an_attitude_that_is_too_old_gives_neutral_sticks_and_then_a_release_never_a_frozen_tilt(leaning):
    ttl, after = leaning.cfg.limiter.setpoint_ttl, leaning.cfg.lease.release_after
    assert {(c.pitch, c.roll) for c in leaning.counts(SILENT + ttl + 0.03, SILENT + after)} == {(0, 0)}
    assert leaning.first(ReleaseAircraft)[0] == pytest.approx(SILENT + after, abs=0.1)


def test_an_attitude_begins_no_flight_while_it_leans_and_reaches_no_wire_under_an_old_epoch():
    rig = Leans(replace(CALM, seconds=3.0), sees=False, leans=0.0, pitch=LEAN)
    rig.fly()
    assert rig.counts() == []
    assert rig.status.reason.endswith("waiting for a level attitude")
    old = AttitudeSetpoint(epoch=rig._epoch - 1, sequence=9999, ttl=0.3, **LEVEL)
    refused = rig.core.feed(SetpointAccepted(old, rig._epoch), 3.5).refusal
    assert refused.token == "wrong_epoch"


def test_the_limiter_bounds_tilt_and_its_rate_of_change():
    rig = Leans(replace(CALM, seconds=3.4), sees=False, pitch=math.radians(44.0), yaw_rate=3.0)
    rig.fly()
    sent = rig.of(SendSticks, 2.9, 3.3)
    limits = rig.cfg.limiter
    assert max(a.counts.pitch for _, a in sent) == limits.max_pitch
    assert max(a.counts.yaw for _, a in sent) <= limits.max_yaw
    steps = [(b.counts.pitch - a.counts.pitch) / (t - s) for (s, a), (t, b) in pairwise(sent)]
    assert max(steps) <= limits.slew * 1.2
    assert all(a.is_limited for at, a in sent if at > 3.05)

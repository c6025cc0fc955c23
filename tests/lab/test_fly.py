"""What a flight of the whole daemon is judged by; the flight itself is that of tests/client/test_library_page.py."""

from __future__ import annotations

import math

import pytest

from lab.fly import PERIOD, SETTLING, build_figures
from lab.rigs.overtarget import HEIGHT, Seen
from mkdaemon.client import Sample


def take(seen, suffix, at, **fields):
    seen.take(Sample(suffix, {"stamp": {"monotonic": at}, **fields}, ""))


def flight(*, farthest=0.1, until=20.0):
    """An aircraft that stands 10 cm beside its goal, but for one moment, while the machine flies from 100 s on."""
    seen = Seen()
    for number in range(int(until / PERIOD)):
        at = 100.0 + number * PERIOD
        x = farthest if number == int(15.0 / PERIOD) else 0.1
        take(seen, "sim/truth", at, controlled=True, position_enu=(x, 0.0, HEIGHT), velocity_enu=(0.0, 0.0, 0.0))
        take(seen, "control/output", at)
    take(seen, "vision/down/pose", 101.0, latency=0.08, delivered=0.06)
    return seen


def test_a_hold_near_the_goal_holds():
    figures = build_figures(flight(), 100.0, 0.25, "")
    assert figures["holds"]
    assert figures["hover_rms_cm"] == figures["hover_max_cm"] == 10.0
    assert figures["held_s"] == pytest.approx(20.0 - SETTLING, abs=0.03)
    assert figures["image_latency_p50_ms"] == 80.0
    assert figures["frame_gap_max_ms"] == pytest.approx(20.0)
    assert figures["daemon_cpu_percent"] == 25.0


def test_one_moment_far_from_the_goal_or_a_lost_lease_is_no_hold():
    figures = build_figures(flight(farthest=0.6), 100.0, 0.25, "")
    assert (figures["holds"], figures["hover_max_cm"]) == (False, 60.0)
    assert not build_figures(flight(), 100.0, 0.25, "the lease is lost")["holds"]


def test_a_flight_that_never_began_has_no_figures():
    figures = build_figures(Seen(), math.nan, math.nan, "refused")
    assert (figures["holds"], figures["held_s"], figures["hover_max_cm"]) == (False, 0.0, None)


def test_phases_and_what_the_ladder_did_are_kept_once():
    seen = Seen()
    for phase in ("free", "leased", "leased", "flying"):
        take(seen, "control/status", 1.0, phase=phase, reason="asked for")
    take(seen, "event/failsafe", 2.0, action="hold", reason="no setpoint")
    assert seen.phases == ["free: asked for", "leased: asked for", "flying: asked for"]
    assert seen.failsafes == ["hold: no setpoint"]


@pytest.mark.parametrize(("height", "speed", "hovers"), [(2.0, 0.1, True), (1.5, 0.1, False), (2.0, 0.4, False)])
def test_the_pilot_hovers_when_high_and_slow_with_the_target_in_sight(height, speed, hovers):
    seen = Seen()
    take(seen, "sim/truth", 1.0, controlled=False, position_enu=(0.0, 0.0, height), velocity_enu=(speed, 0.0, 0.0))
    assert not seen.is_hovering()
    take(seen, "vision/down/pose", 1.0, latency=0.1, delivered=0.08)
    assert seen.is_hovering() is hovers

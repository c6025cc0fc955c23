"""Stick frames: how long each may wait for the line, how far apart they are, and what is counted of them."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from mkdaemon.config.control import ControlConfig, LimiterConfig
from mkdaemon.control.authority import Fly
from mkdaemon.control.limiter import StickCounts, Sticks
from mkdaemon.control.output import SHORTEST_STEP, StickOutput
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.telemetry.control import ControlLine
from tests.control.events import flight, pilot

PITCHED = Sticks(10.0, 0.0, 0.0, 20.0)
FAST = LimiterConfig(slew=20_000, throttle_slew=20_000, hover_throttle=5.0)


def order(*, age=0.0, ttl=1.0, sticks=PITCHED):
    return Fly(sticks=sticks, age=age, ttl=ttl, epoch=7, sequence=41)


def output(*, facts=None, limiter=FAST, rate=50.0, engaged=1.0, sticks=PITCHED):
    """Frames of a flight that began at a time [s] with these sticks."""
    made = StickOutput(ControlConfig(limiter=limiter, rate=rate), facts or VehicleMemory())
    made.engage(sticks, engaged)
    return made


@pytest.mark.parametrize(
    ("age", "ttl", "life"),
    [
        (0.0, 1.0, 0.1),  # a fresh setpoint: as long as the queue keeps anything
        (0.15, 1.0, 0.1),
        (0.25, 1.0, 0.05),  # 0.3 s is the daemon's own limit, whatever the client claims
        (0.29, 1.0, 0.01),
        (0.1, 0.12, 0.02),  # the client's limit is shorter
        (0.3, 1.0, 0.0),
        (0.4, 1.0, 0.1),  # stale: neutral sticks, which are right until something newer comes
        (0.13, 0.12, 0.1),
    ],
)
def test_no_frame_leaves_after_its_setpoint_has_grown_stale(age, ttl, life):
    made = output().make(order(age=age, ttl=ttl), "v2", 1.5)
    assert made.deadline == pytest.approx(1.5 + life)
    assert (made.epoch, made.sequence, made.age) == (7, 41, age)


def test_a_frame_says_what_was_wanted_and_whether_it_was_limited():
    out = output()
    free = out.make(order(), "v2", 1.02)
    assert (free.is_limited, free.wanted) == (False, PITCHED)
    far = out.make(order(sticks=Sticks(90.0, 0.0, 0.0, 20.0)), "v2", 1.04)
    assert (far.is_limited, far.wanted.pitch, far.counts.pitch) == (True, 90.0, 60)


def test_sticks_move_from_the_last_frame_by_the_time_between_the_two():
    """Tilt and yaw begin at neutral, throttle where the client holds it."""
    slow = LimiterConfig(slew=100.0, throttle_slew=100.0, hover_throttle=0.0)
    out = output(limiter=slow, engaged=10.0, sticks=Sticks(50.0, 50.0, 50.0, 20.0))
    wanted = order(sticks=Sticks(50.0, -50.0, 50.0, 40.0))
    assert out.make(wanted, "v2", 10.0).counts == StickCounts(2, -2, 2, 22)  # one period of 50 Hz
    assert out.make(wanted, "v2", 10.05).counts == StickCounts(7, -7, 7, 27)
    assert out.make(wanted, "v2", 10.05).counts == StickCounts(8, -8, 8, 28)  # never less than 10 ms


@pytest.mark.parametrize(("line", "step"), [(0.0, 0.01), (0.01, 0.01), (0.02, 0.02), (0.03, 0.03), (0.2, 0.03)])
def test_frames_are_as_far_apart_as_boards_and_line_need(line, step):
    out = output(rate=100.0)
    out.line = ControlLine("v2", shortest_step=line)
    assert out.step == step
    out.make(order(), "v2", 5.0)
    assert out.next_step == pytest.approx(5.0 + step)


def test_frames_may_run_ahead_of_the_rate_by_two_periods_and_no_more():
    out = output(rate=20.0)  # a frame every 50 ms; the boards would take one every 10 ms
    now, times = 1.0, []
    for _ in range(6):
        out.make(order(), "v2", now)
        times.append(now)
        now = out.next_step
    gaps = [after - before for before, after in itertools.pairwise(times)]
    assert gaps == pytest.approx([0.01, 0.01, 0.03, 0.05, 0.05], abs=1e-9)


def test_an_answer_to_an_image_is_beside_the_rate():
    out = output(rate=20.0)
    for count in range(10):
        out.make(order(), "v2", 1.0 + 0.01 * count, is_extra=True)
    assert out.next_step == pytest.approx(1.09 + SHORTEST_STEP)


@pytest.mark.parametrize(
    ("is_flying", "stick", "hover", "throttle"),
    [
        (True, None, None, 5),  # nothing known: hover
        (True, None, 12.0, 12),  # what the estimate knows to carry
        (True, None, -8.0, -8),
        (True, -30.0, None, -30),  # the pilot's stick is lower
        (True, 30.0, None, 5),
        (False, None, None, -20),  # on the ground: no more than now
        (False, -30.0, None, -30),
        (False, 30.0, None, -20),
        (None, None, None, -20),
    ],
)
def test_stale_throttle_is_capped_by_the_pilot_and_on_the_ground_by_what_was_sent(is_flying, stick, hover, throttle):
    facts = VehicleMemory()
    if is_flying is not None:
        facts.state_received(flight(is_flying=is_flying), 10.0)
    if stick is not None:
        facts.state_received(pilot(stick), 10.0)
    out = output(facts=facts, engaged=10.0, sticks=Sticks(0.0, 0.0, 0.0, -20.0))
    assert out.make(order(age=0.9), "v2", 10.0, hover=hover).counts == StickCounts(0, 0, 0, throttle)


def test_where_the_ground_may_be_touched_nothing_that_nobody_asked_for_raises_the_throttle():
    """What is sent when a setpoint goes stale depends on whether the feet stand.

    A board may say that the aircraft flies while its motors run; what is flown knows that it has landed.
    """
    facts = VehicleMemory()
    facts.state_received(flight(is_flying=True), 1.0)
    low = Sticks(0.0, 0.0, 0.0, -100.0)
    out = output(facts=facts, sticks=low)
    assert out.make(replace(order(sticks=low, age=0.4), may_touch=True), "v2", 1.1).counts.throttle == -100
    assert output(facts=facts, sticks=low).make(order(sticks=low, age=0.4), "v2", 1.1).counts.throttle == 5
    asked = replace(order(), may_touch=True)
    assert out.make(asked, "v2", 1.12).counts.throttle == 20, "what somebody asked for is flown"


@pytest.mark.parametrize(
    ("is_flying", "motors", "throttle"), [(True, True, 5), (None, True, 5), (False, True, -100), (None, False, -100)]
)
def test_level_at_hover_throttle_raises_no_aircraft_that_is_known_to_stand(is_flying, motors, throttle):
    """An abort of a flight by stick, on the pad at idle."""
    facts, low = VehicleMemory(), Sticks(0.0, 0.0, 0.0, -100.0)
    facts.state_received(flight(is_flying=is_flying), 1.0)
    facts.motors_reported(motors, 1.0)
    level = replace(order(sticks=Sticks(0.0, 0.0, 0.0, 5.0)), is_level=True)
    assert output(facts=facts, sticks=low).make(level, "v2", 1.1).counts.throttle == throttle


def test_frames_are_counted_from_the_hand_over_to_the_confirmation():
    out = output()
    assert out.dropped(is_flying=True) == out.dropped(is_flying=False) == 0
    for number in range(3):
        out.make(order(), "v2", 1.0 + 0.02 * number)
    assert (out.handed_over, out.sent, out.confirmed) == (3, 0, 0)
    assert out.dropped(is_flying=True) == 2  # the newest may still leave
    assert out.dropped(is_flying=False) == 3
    out.frame_sent(9)
    assert (out.sent, out.dropped(is_flying=True), out.dropped(is_flying=False)) == (1, 2, 2)
    out.frame_confirmed(8)  # of a release
    assert out.confirmed == 0
    out.frame_confirmed(9)
    out.frame_confirmed(9)
    assert out.confirmed == 1


def test_the_lid_is_shown_the_throttle_that_leaves_and_what_it_is_reported_as():
    facts = VehicleMemory()
    facts.state_received(pilot(None).model_copy(update={"throttle_in_use": 1.0, "compensated_at": 14.8}), 9.9)
    out = output(facts=facts, engaged=10.0)
    shown = []
    out.lid.frame_made = lambda *told: shown.append(told)
    out.make(order(), "v2", 10.0, low_cell=3.5)
    assert shown == [(20.0, facts.throttle_in_use(3.5), 10.0)]
    assert shown[0][1].share == pytest.approx(14.0 / 14.8)

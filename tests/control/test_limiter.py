"""The last function before the wire: dense around every limit, then everything at random."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mkdaemon.config.control import HIGHEST_HOVER, LOWEST_HOVER, LimiterConfig
from mkdaemon.control.limiter import GESTURE_LOW, GESTURE_YAW, LONGEST_STEP, RANGES, StickCounts, Sticks, count, limit

WIDE = LimiterConfig(
    max_pitch=127, max_roll=127, max_yaw=127, min_throttle=-127, max_throttle=127, slew=20_000, throttle_slew=20_000
)
CFG = LimiterConfig()
REST = Sticks(0.0, 0.0, 0.0, 0.0)
EPS = 1e-6


def limited(wanted, last=REST, *, age=0.0, ttl=1.0, dt=0.02, layout="v2", cfg=WIDE, throttle_cap=None):
    return limit(wanted, last, age=age, ttl=ttl, dt=dt, layout=layout, cfg=cfg, throttle_cap=throttle_cap)


def around(*edges):
    """Values at, just inside and just outside each edge."""
    return sorted({edge + step for edge in edges for step in (-1, -0.5, -EPS, 0, EPS, 0.5, 1)})


@pytest.mark.parametrize("axis", ["pitch", "roll", "yaw"])
@pytest.mark.parametrize("bound", [0, 1, 40, 60, 126, 127])
def test_tilt_and_yaw_stay_within_their_own_bound(axis, bound):
    cfg = WIDE.model_copy(update={f"max_{axis}": bound})
    bound = min(bound, GESTURE_YAW) if axis == "yaw" else bound
    for value in around(-127, -bound, 0, bound, 127):
        wanted = Sticks(**{"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0, axis: value})
        expected = min(max(value, -bound), bound)
        assert getattr(limited(wanted, wanted, cfg=cfg), axis) == expected
        assert abs(getattr(count(limited(wanted, wanted, cfg=cfg)), axis)) <= bound


@pytest.mark.parametrize(("low", "high"), [(-127, 127), (-100, 80), (-50, 60), (0, 0), (-1, 1)])
def test_throttle_stays_within_its_bounds(low, high):
    cfg = WIDE.model_copy(update={"min_throttle": low, "max_throttle": high, "hover_throttle": float(low)})
    for value in around(-127, low, 0, high, 127):
        wanted = Sticks(0.0, 0.0, 0.0, value)
        assert limited(wanted, wanted, cfg=cfg).throttle == min(max(value, low), high)
        assert low <= count(limited(wanted, wanted, cfg=cfg)).throttle <= high


def test_what_is_within_all_bounds_passes_untouched():
    wanted = Sticks(10.0, -20.0, 30.0, 40.0)
    assert limited(wanted, wanted) == wanted
    assert count(wanted) == StickCounts(10, -20, 30, 40)


@pytest.mark.parametrize("layout", sorted(RANGES))
def test_no_configuration_goes_beyond_what_the_layout_carries(layout):
    far = Sticks(500.0, -500.0, 500.0, 90.0)
    counts = count(limited(far, far, layout=layout))
    assert counts == StickCounts(127, -127, 70, 90)
    assert count(limited(Sticks(0, 0, 0, 500.0), Sticks(0, 0, 0, 500.0), layout=layout)).throttle == 127


def test_an_unknown_layout_is_refused():
    with pytest.raises(KeyError):
        limited(REST, layout="v4")


@pytest.mark.parametrize(
    ("age", "ttl", "is_stale"),
    [
        (0.0, 0.3, False),
        (0.3 - EPS, 0.3, False),
        (0.3, 0.3, False),
        (0.3 + EPS, 0.3, True),
        (0.3 + EPS, 1.0, True),  # a longer life than the configuration grants
        (0.1, 0.1, False),
        (0.1 + EPS, 0.1, True),  # a shorter one
        (-EPS, 0.3, True),  # from the future: some clock is wrong
        (1e9, 0.3, True),
    ],
)
def test_a_setpoint_lives_as_long_as_it_says_and_never_longer_than_configured(age, ttl, is_stale):
    flying = Sticks(20.0, 20.0, 20.0, 30.0)
    result = limited(flying, flying, age=age, ttl=ttl)
    assert result == (Sticks(0.0, 0.0, 0.0, WIDE.hover_throttle) if is_stale else flying)


@pytest.mark.parametrize(
    ("cap", "throttle"),
    [(None, 10.0), (127.0, 10.0), (10.0 + EPS, 10.0), (10.0, 10.0), (9.0, 9.0), (-80.0, -50.0)],
)
def test_a_stale_command_holds_hover_throttle_or_the_pilots_whichever_is_less(cap, throttle):
    cfg = LimiterConfig(hover_throttle=10.0, min_throttle=-50)
    flying = Sticks(20.0, 0.0, 0.0, 50.0)
    assert limited(flying, flying, age=0.5, cfg=cfg, throttle_cap=cap).throttle == throttle


@pytest.mark.parametrize(("axis", "most"), [("pitch", 12.0), ("roll", 12.0), ("yaw", 12.0), ("throttle", 6.0)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_stick_moves_no_faster_than_the_slew_and_throttle_than_its_own(axis, most, sign):
    cfg = WIDE.model_copy(update={"slew": 600.0, "throttle_slew": 300.0})
    for distance in around(0, 6, 12, 100):
        wanted = Sticks(**{"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0, axis: sign * distance})
        moved = getattr(limited(wanted, cfg=cfg, dt=0.02), axis)
        assert moved == pytest.approx(sign * max(min(distance, most), -most))


def test_a_loop_that_stood_still_does_not_jump_when_it_wakes():
    cfg = WIDE.model_copy(update={"slew": 100.0})
    assert limited(Sticks(100.0, 0, 0, 0), cfg=cfg, dt=60.0).pitch == pytest.approx(10.0)


def test_slow_slew_still_arrives():
    cfg = WIDE.model_copy(update={"slew": 5.0})
    sticks, wanted = REST, Sticks(3.0, 0.0, 0.0, 0.0)
    for _ in range(40):
        sticks = limited(wanted, sticks, cfg=cfg, dt=0.02)
    assert count(sticks).pitch == 3


def test_low_throttle_never_meets_yaw():
    yaws = around(-127, -101, -100, -70, -1, 0, 1, 70, 100, 101, 127)
    throttles = around(-127, -101, GESTURE_LOW, -99)
    for yaw, throttle in itertools.product(yaws, throttles):
        wanted = Sticks(0.0, 0.0, yaw, throttle)
        counts = count(limited(wanted, wanted))
        assert not (counts.throttle < -100 and abs(counts.yaw) > 0)
        if throttle >= GESTURE_LOW:
            assert counts.yaw == round(min(max(yaw, -GESTURE_YAW), GESTURE_YAW))


def test_the_slew_cannot_walk_into_a_gesture():
    wanted, sticks = Sticks(0.0, 0.0, -127.0, -127.0), Sticks(0.0, 0.0, -127.0, 0.0)
    cfg = WIDE.model_copy(update={"slew": 600.0, "throttle_slew": 300.0})
    for _ in range(100):
        sticks = limited(wanted, sticks, cfg=cfg)
        assert not (count(sticks).throttle < -100 and count(sticks).yaw != 0)
    assert count(sticks) == StickCounts(0, 0, 0, -127)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(12))
def test_no_nan_and_no_infinity_anywhere(bad, place):
    numbers = [0.0] * 8 + [0.0, 0.3, 0.02, 0.0]
    numbers[place] = bad
    wanted, last, (age, ttl, dt, cap) = Sticks(*numbers[:4]), Sticks(*numbers[4:8]), numbers[8:]
    with pytest.raises(ValueError, match="cannot limit"):
        limited(wanted, last, age=age, ttl=ttl, dt=dt, throttle_cap=cap)
    for stands_still in (0.0, -0.02):
        with pytest.raises(ValueError, match="cannot limit"):
            limited(REST, dt=stands_still)


numbers = st.floats(-1e6, 1e6)
bounds = st.integers(0, 127)


@st.composite
def configurations(draw):
    low, high = draw(st.integers(-127, int(HIGHEST_HOVER))), draw(st.integers(int(LOWEST_HOVER), 127))
    low, high = min(low, high), max(low, high)
    hover = draw(st.integers(max(low, int(LOWEST_HOVER)), min(high, int(HIGHEST_HOVER))))
    return LimiterConfig(
        max_pitch=draw(bounds),
        max_roll=draw(bounds),
        max_yaw=draw(bounds),
        min_throttle=low,
        max_throttle=high,
        hover_throttle=float(hover),
        slew=draw(st.floats(0.1, 20_000)),
        throttle_slew=draw(st.floats(0.1, 20_000)),
        setpoint_ttl=draw(st.floats(0.01, 1.0)),
    )


@st.composite
def sticks_within(draw, cfg):
    axis = {name: draw(st.floats(-getattr(cfg, f"max_{name}"), getattr(cfg, f"max_{name}"))) for name in AXES}
    return Sticks(**axis, throttle=draw(st.floats(cfg.min_throttle, cfg.max_throttle)))


AXES = ("pitch", "roll", "yaw")


@settings(max_examples=max(100, settings.default.max_examples))
@given(data=st.data())
def test_nothing_outside_the_bounds_leaves_whatever_comes(data):
    cfg = data.draw(configurations())
    wanted = Sticks(*(data.draw(numbers) for _ in range(4)))
    last = data.draw(sticks_within(cfg))
    age, ttl, dt = data.draw(st.floats(-1, 2)), data.draw(st.floats(0, 2)), data.draw(st.floats(1e-4, 10))
    cap = data.draw(st.none() | numbers)
    result = limit(
        wanted,
        last,
        age=age,
        ttl=ttl,
        dt=dt,
        layout=data.draw(st.sampled_from(sorted(RANGES))),
        cfg=cfg,
        throttle_cap=cap,
    )
    counts = count(result)
    for axis in AXES:
        assert abs(getattr(counts, axis)) <= getattr(cfg, f"max_{axis}")
    assert cfg.min_throttle <= counts.throttle <= cfg.max_throttle
    assert not (counts.throttle < -100 and counts.yaw)
    assert abs(counts.yaw) <= 75
    if not 0 <= age <= min(ttl, cfg.setpoint_ttl):
        assert (result.pitch, result.roll, result.yaw) == (0.0, 0.0, 0.0)
        assert result.throttle <= max(cfg.hover_throttle, cfg.min_throttle)
        return
    step = cfg.slew * min(dt, LONGEST_STEP) * (1 + 1e-9) + 1e-9
    assert abs(result.pitch - last.pitch) <= step
    assert abs(result.roll - last.roll) <= step
    assert abs(result.throttle - last.throttle) <= cfg.throttle_slew * min(dt, LONGEST_STEP) * (1 + 1e-9) + 1e-9
    # The gesture guard may take yaw back faster than the slew, but only towards zero.
    assert abs(result.yaw - last.yaw) <= step or abs(result.yaw) <= GESTURE_YAW


@settings(max_examples=max(100, settings.default.max_examples))
@given(data=st.data())
def test_repeating_a_command_converges_on_the_nearest_allowed_one(data):
    cfg = data.draw(configurations())
    wanted = Sticks(*(data.draw(st.floats(-200, 200)) for _ in range(4)))
    free = cfg.model_copy(update={"slew": 20_000.0, "throttle_slew": 20_000.0})
    last = data.draw(sticks_within(cfg))
    once = limited(wanted, last, cfg=free)
    again = limited(wanted, once, cfg=free)
    assert again == pytest.approx(once)
    for axis in ("pitch", "roll"):
        bound = getattr(cfg, f"max_{axis}")
        assert getattr(once, axis) == pytest.approx(min(max(getattr(wanted, axis), -bound), bound))
    assert once.throttle == pytest.approx(min(max(wanted.throttle, cfg.min_throttle), cfg.max_throttle))

"""Margins of the loop against loops whose limits are known, and the flight on the model against what it must hold."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.estimator.model import ACCELEROMETER_SCALE, LEAK_SLOW, NO_FILTER, AircraftModel
from mkdaemon.control.regulator.horizontal import COSTS, HorizontalCosts, HorizontalRegulator
from mkdaemon.control.regulator.margins import (
    NAMES,
    _delayed_radius,
    fly_model,
    gains_of,
    loop_refusal,
    require_safe_loop,
)
from mkdaemon.errors import ConfigError

MODEL = AircraftModel()


@cache
def found(rate=50.0):
    """Margins of the set Easy."""
    return gains_of(MODEL, ControlConfig(rate=rate))


def radius(rate=50.0, *, factor=1.0, late=0, model=MODEL):
    """Largest eigenvalue of all loops whose stick does `factor` of what it should, some periods late."""
    return max(_radius(HorizontalRegulator(model, costs).gain, rate, factor, late, model) for costs in COSTS)


def _radius(gain, rate, factor, late, model):
    f, g = (each[:7] for each in model.horizontal(1.0 / rate))
    loop = np.zeros((7 + late, 7 + late))
    loop[:7, :7] = f[:, :7]
    if late:
        loop[:7, -1] = g
        loop[7, :7] = -factor * gain
        loop[8:, 7:-1] = np.eye(late - 1)
    else:
        loop[:7, :7] -= factor * np.outer(g, gain)
    return float(np.abs(np.linalg.eigvals(loop)).max())


@pytest.mark.parametrize("rate", [50.0, 25.0])
def test_the_loop_is_stable_just_inside_its_gain_margin_and_not_just_outside(rate):
    low, high = found(rate).gain_margin
    grid = 400.0 ** (1.0 / 240.0)
    assert radius(rate, factor=high * 0.999) < 1.0 <= radius(rate, factor=high * grid * 1.001)
    assert radius(rate, factor=low * 1.001) < 1.0
    assert low == pytest.approx(0.05) or radius(rate, factor=low / grid * 0.999) >= 1.0
    assert found(rate).radius == pytest.approx(radius(rate))


@pytest.mark.parametrize("rate", [50.0, 25.0])
def test_the_loop_bears_its_delay_margin_and_not_a_period_more(rate):
    late = round(found(rate).delay_margin * rate)
    assert found(rate).delay_margin == pytest.approx(late / rate)
    assert radius(rate, late=late) < 1.0 <= radius(rate, late=late + 1)


@pytest.mark.parametrize("steps", [1, 2, 3, 7])
def test_an_integrator_bears_the_gain_that_the_theory_of_its_delay_gives(steps):
    """x+ = x - k x[-n] is stable for 0 < k < 2 sin(pi / (4 n + 2)); S. Levin and R. May, Theor. Pop. Biol. 9 (1976)."""
    limit = 2.0 * math.sin(math.pi / (4 * steps + 2))
    one = np.eye(1)
    assert (
        _delayed_radius(one, one, 0.99 * limit * one, steps)
        < 1.0
        < _delayed_radius(one, one, 1.01 * limit * one, steps)
    )


@pytest.mark.parametrize("changes", [{}, {"a1": 3.41, "a2": 7.1}])
def test_what_is_told_of_a_loop_is_of_the_model_and_of_what_it_must_bear(changes):
    model = replace(MODEL, **changes)
    told, regulator = gains_of(model, ControlConfig()), HorizontalRegulator(model, HorizontalCosts())
    assert told.degrees_per_count == pytest.approx(0.451)
    for name in ("a1", "a2", "leak", "stick_filter", "uplink"):
        assert getattr(told, name) == getattr(model, name)
    assert tuple(told.gains) == NAMES
    assert list(told.gains.values()) == pytest.approx(regulator.gain)
    assert told.radius == pytest.approx(radius(model=model))
    # The wrong models and the wrong stamps of docs/lab/control.md, and a tenth of a metre.
    assert (told.needed_gain, told.needed_delay, told.farthest_rest) == ((0.67, 1.33), 0.02, 0.1)


def rest(**options):
    return fly_model(MODEL, ControlConfig.model_validate(options))


@pytest.mark.parametrize("rate", [20, 50, 100])
def test_the_model_comes_to_rest_within_centimetres(rate):
    at_rest = rest(rate=rate)
    assert at_rest.level < 0.03
    assert at_rest.height < 0.02


NEEDED = ACCELEROMETER_SCALE * MODEL.drag * 2.0 / 9.81
"""Stick that holds against 2 m/s of wind [rad]: the tilt is drag times that over g, 4.1 degrees, and the boards leak to
what their accelerometers show of it."""


@pytest.mark.parametrize(
    ("part", "options", "holds"),
    [
        # The flight begins half a metre beside, with the wind in its back, which needs 8 to 9 counts.
        *(("level", {"limiter": {axis: 8}}, False) for axis in ("max_pitch", "max_roll")),
        *(("level", {"limiter": {axis: 10}}, True) for axis in ("max_pitch", "max_roll")),
        ("level", {"autopilot": {"max_tilt": 0.95 * NEEDED}}, False),
        ("level", {"autopilot": {"max_tilt": 1.25 * NEEDED}}, True),
        # A tenth more or less thrust than believed is 4.9 % or 5.1 % of the throttle that hovers: 6.1 or 6.4 counts.
        ("height", {"limiter": {"hover_throttle": 0, "max_throttle": 5}}, False),
        ("height", {"limiter": {"hover_throttle": 0, "max_throttle": 8}}, True),
        ("height", {"limiter": {"hover_throttle": 0, "min_throttle": -5}}, False),
        ("height", {"limiter": {"hover_throttle": 0, "min_throttle": -9}}, True),
    ],
)
def test_sticks_must_reach_as_far_as_the_light_wind_and_a_tenth_of_the_weight_need(part, options, holds):
    assert 8.0 < NEEDED / MODEL.rad_per_count < 9.0
    bound, lost = {"level": (0.1, 0.5), "height": (0.05, 0.3)}[part]
    found = getattr(rest(**options), part)
    assert (found < bound) if holds else (found > lost)


def test_it_is_judged_by_its_last_three_seconds_of_twelve():
    """It climbs at the speed that it may: after 9 s of 12 the rest of half a metre is left."""
    assert rest(autopilot={"max_climb": 0.03}).height == pytest.approx(0.5 - 9.0 * 0.03, abs=0.07)
    assert rest(autopilot={"max_climb": 0.03}, rate=20).height == pytest.approx(0.5 - 9.0 * 0.03, abs=0.07)


@pytest.mark.parametrize(
    ("options", "worse"), [({"slew": 100}, "level"), ({"slew": 60}, "level"), ({"throttle_slew": 15}, "height")]
)
def test_sticks_that_move_slowly_let_it_swing(options, worse):
    assert getattr(rest(limiter=options), worse) > 1.5 * getattr(rest(), worse)


def test_an_aircraft_whose_sticks_tilt_more_than_another_rests_as_near():
    """What it is asked for is in counts of its own."""
    assert fly_model(replace(MODEL, rad_per_count=2.0 * MODEL.rad_per_count), ControlConfig()).level < 0.05


def test_margins_that_are_known_are_not_computed_again():
    safe = found()
    assert loop_refusal(MODEL, ControlConfig(limiter={"slew": 50}), safe) is None
    unsafe = safe.model_copy(update={"delay_margin": 0.019, "gain_margin": (0.7, 3.0), "rest_level": 0.2})
    error = loop_refusal(MODEL, ControlConfig(), unsafe)
    assert "0.70 to 3.00 of the model's stick gain, 19 ms more delay" in error.reason
    assert "0.20 m beside" in error.reason
    assert "this parameter set" in error.reason
    assert "Easy" in error.fix


@pytest.mark.parametrize(
    "change",
    [
        {"radius": 1.0},
        {"gain_margin": (0.68, 3.0)},
        {"gain_margin": (0.3, 1.32)},
        {"delay_margin": 0.019},
        {"rest_level": 0.11},
        {"rest_height": 0.11},
    ],
)
def test_a_loop_is_safe_while_every_margin_is_as_large_as_it_must_be(change):
    assert found().is_safe
    assert not found().model_copy(update=change).is_safe
    just = {"gain_margin": (0.67, 1.33), "delay_margin": 0.02, "rest_level": 0.1, "rest_height": 0.1}
    assert found().model_copy(update=just).is_safe


def test_a_set_that_nothing_stabilises_is_named_and_not_the_configuration():
    error = loop_refusal(replace(MODEL, a1=1e-200, a2=1e-200), ControlConfig.model_validate({"limiter": {"slew": 50}}))
    assert "no gain stabilises" in error.reason
    assert "parameter set" in error.reason


def test_a_fast_aircraft_that_is_steered_seldom_bears_nothing():
    """Of the gains from a twentieth to twenty times the model's only small ones are stable, and no delay."""
    fast = replace(MODEL, a1=20.0, a2=200.0)
    seldom = gains_of(fast, ControlConfig(rate=10.0))
    assert seldom.radius == pytest.approx(radius(10.0, model=fast))
    assert seldom.radius > 1.0
    assert seldom.delay_margin == 0.0
    assert radius(10.0, late=1, model=fast) > 1.0
    low, high = seldom.gain_margin
    assert low == pytest.approx(0.05)
    assert high < 1.0
    assert radius(10.0, factor=high, model=fast) < 1.0 < radius(10.0, factor=1.03 * high, model=fast)
    assert not seldom.is_safe


def refused(**options):
    """Why a configuration is refused on the model of the set Easy; None where it is not."""
    return loop_refusal(AircraftModel(), ControlConfig.model_validate(options))


def test_the_default_configuration_is_safe_on_every_set_and_firmware():
    for changes in ({}, {"leak": LEAK_SLOW}, {"stick_filter": NO_FILTER}, {"a1": 3.41, "a2": 7.1}):
        assert loop_refusal(replace(AircraftModel(), **changes), ControlConfig()) is None


@pytest.mark.parametrize(
    ("options", "name", "remedy"),
    [
        ({"limiter": {"slew": 50}}, "control.limiter.slew = 50", "set it to 600"),
        ({"limiter": {"throttle_slew": 5}}, "control.limiter.throttle_slew = 5", "set it to"),
        ({"limiter": {"max_pitch": 6}}, "control.limiter.max_pitch = 6", "set it to"),
        ({"limiter": {"max_throttle": 0}}, "control.limiter.max_throttle = 0", "set it to"),
        ({"autopilot": {"max_tilt": 0.05}}, "control.autopilot.max_tilt = 0.05", "set it to"),
        ({"rate": 40, "limiter": {"slew": 50}}, "control.limiter.slew = 50", "600"),
        (
            {"limiter": {"slew": 50, "max_throttle": 0}},
            "control.limiter.max_throttle = 0, control.limiter.slew = 50",
            "take them out",
        ),
    ],
)
def test_a_value_that_makes_the_loop_unsafe_is_named_with_the_margin_and_the_remedy(options, name, remedy):
    error = refused(**options)
    assert error.token == "loop_unstable"
    assert name in error.reason
    assert "rate" not in error.reason
    assert "m beside" in error.reason
    assert remedy in error.fix


@pytest.mark.parametrize("options", [{"rate": 25}, {"limiter": {"slew": 300}}, {"autopilot": {"max_tilt": 0.2}}])
def test_other_values_are_not_refused(options):
    assert refused(**options) is None


def test_a_parameter_set_that_cannot_be_flown_is_refused_whatever_the_configuration():
    error = loop_refusal(replace(AircraftModel(), rad_per_count=1e-4), ControlConfig())
    assert "this parameter set" in error.reason


LIMITS = {"max_pitch": 6, "max_roll": 50, "min_throttle": -90, "max_throttle": 70, "slew": 500}
LIMITS |= {"throttle_slew": 200, "hover_throttle": 0}
NO_DEFAULTS = {"rate": 40, "limiter": LIMITS, "autopilot": {"max_tilt": 0.3, "max_climb": 0.5}}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"limiter": {"slew": 50}}, r"control\.limiter\.slew = 50.*set it to 600"),
        (NO_DEFAULTS, r"control\.limiter\.max_pitch = 6"),
    ],
)
def test_the_daemon_does_not_start_with_a_value_that_makes_the_loop_unsafe(options, words):
    require_safe_loop(ControlConfig())
    require_safe_loop(ControlConfig(rate=40.0))
    with pytest.raises(ConfigError, match=words):
        require_safe_loop(ControlConfig.model_validate(options))

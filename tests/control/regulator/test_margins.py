"""Margins of the horizontal loop, as they are shown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.estimator.model import LEAK_SLOW, NO_FILTER, AircraftModel
from mkdaemon.control.regulator.margins import NAMES, gains_of, loop_refusal, require_safe_loop
from mkdaemon.errors import ConfigError


def test_the_model_that_is_shown_is_the_one_that_is_flown_on():
    found = gains_of(replace(AircraftModel(), a1=3.41, a2=7.1), ControlConfig())
    assert (found.a1, found.a2) == (3.41, 7.1)
    assert tuple(found.gains) == NAMES
    assert found.gains["position"] != pytest.approx(gains_of(AircraftModel(), ControlConfig()).gains["position"])


def refused(**options):
    """Why a configuration is refused on the model of the set Easy; None where it is not."""
    return loop_refusal(AircraftModel(), ControlConfig.model_validate(options))


def test_the_default_configuration_is_safe_on_every_set_and_firmware():
    for changes in ({}, {"leak": LEAK_SLOW}, {"stick_filter": NO_FILTER}, {"a1": 3.41, "a2": 7.1}):
        assert loop_refusal(replace(AircraftModel(), **changes), ControlConfig()) is None


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"limiter": {"slew": 50}}, "control.limiter.slew = 50"),
        ({"limiter": {"throttle_slew": 5}}, "control.limiter.throttle_slew = 5"),
        ({"limiter": {"max_pitch": 6}}, "control.limiter.max_pitch = 6"),
        ({"limiter": {"max_throttle": 0}}, "control.limiter.max_throttle = 0"),
        ({"autopilot": {"max_tilt": 0.05}}, "control.autopilot.max_tilt = 0.05"),
    ],
)
def test_a_value_that_makes_the_loop_unsafe_is_named_with_the_margin_and_the_remedy(options, name):
    error = refused(**options)
    assert error.token == "loop_unstable"
    assert name in error.reason
    assert "m beside" in error.reason
    assert "set it to" in error.fix


def test_two_values_that_are_each_too_much_are_named_together():
    error = refused(limiter={"slew": 50, "max_throttle": 0})
    assert "control.limiter.max_throttle = 0, control.limiter.slew = 50" in error.reason
    assert "take them out" in error.fix


@pytest.mark.parametrize("options", [{"rate": 25}, {"limiter": {"slew": 300}}, {"autopilot": {"max_tilt": 0.2}}])
def test_other_values_are_not_refused(options):
    assert refused(**options) is None


def test_a_parameter_set_that_cannot_be_flown_is_refused_whatever_the_configuration():
    error = loop_refusal(replace(AircraftModel(), rad_per_count=1e-4), ControlConfig())
    assert "this parameter set" in error.reason


def test_the_daemon_does_not_start_with_a_value_that_makes_the_loop_unsafe():
    require_safe_loop(ControlConfig())
    require_safe_loop(ControlConfig(rate=40.0))
    with pytest.raises(ConfigError, match=r"control\.limiter\.slew = 50.*set it to 600"):
        require_safe_loop(ControlConfig.model_validate({"limiter": {"slew": 50}}))


def test_the_daemon_does_not_start_with_an_unsafe_loop_when_no_value_is_the_default():
    limits = {"max_pitch": 6, "max_roll": 50, "min_throttle": -90, "max_throttle": 70, "slew": 500}
    limits |= {"throttle_slew": 200, "hover_throttle": 0}
    options = {"rate": 40, "limiter": limits, "autopilot": {"max_tilt": 0.3, "max_climb": 0.5}}
    with pytest.raises(ConfigError, match=r"control\.limiter\.max_pitch = 6"):
        require_safe_loop(ControlConfig.model_validate(options))

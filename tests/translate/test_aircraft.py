"""The model of the aircraft from its own parameter set."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.control.estimator.model import (
    LEAK_FAST,
    LEAK_SLOW,
    NO_FILTER,
    STICK_FILTER,
    AircraftModel,
    Gap,
    ModelUnknown,
)
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.generations import Release
from mkdaemon.protocol.settings import ParameterSet, layout_of
from mkdaemon.translate import aircraft_model, assumed_model
from mksim.boards.parameters import factory_set

EASY = {"stick_p": 6, "gyro_p": 100, "gyro_i": 120, "integral_factor": 16, "gyro_stability": 6, "stick_yaw_p": 4}
"""The factory's first set; its angle a count and its gains are those of docs/control.md."""


def parameters(revision=106, **changes):
    return ParameterSet.from_payload(bytes([revision]) + bytes(143)).replaced({**EASY, **changes})


def model(*, has_filter=True, has_slow_leak=False, **changes):
    dialect = replace(Dialect(), stick_filter=has_filter)
    return aircraft_model(parameters(**changes), dialect, has_slow_leak=has_slow_leak)


@pytest.mark.parametrize(
    ("release", "via_navictrl", "has_filter", "age"),
    [
        (Release(0, 84), True, False, 0.080),
        (Release(2, 8), True, False, 0.080),
        (Release(0, 84), False, False, 0.030),
        (Release(2, 12), True, True, 0.030),
        (None, True, False, 0.030),
    ],
)
def test_attitudes_of_an_old_flightctrl_behind_a_navictrl_are_older(release, via_navictrl, has_filter, age):
    dialect = replace(Dialect(), fc_release=release, via_navictrl=via_navictrl, stick_filter=has_filter)
    for found in (assumed_model(dialect), aircraft_model(parameters(), dialect, has_slow_leak=False)):
        assert found.attitude_age == pytest.approx(age + 0.009)
        assert found.by_line(0.02).attitude_age == pytest.approx(age + 0.02)


def test_the_easy_set_gives_the_documented_constants_and_firmware_and_navictrl_filter_and_leak():
    found = model()
    assert math.degrees(found.rad_per_count) == pytest.approx(0.451, abs=0.001)
    assert found.a1 == pytest.approx(3.10, abs=0.01)
    assert found.a2 == pytest.approx(3.33, abs=0.02)
    assert (found.stick_filter, found.leak) == (STICK_FILTER, LEAK_FAST)
    assert model(has_filter=False).stick_filter == NO_FILTER
    assert model(has_slow_leak=True).leak == LEAK_SLOW
    assert assumed_model(replace(Dialect(), stick_filter=True)) == AircraftModel()
    assert assumed_model(Dialect()) == replace(AircraftModel(), stick_filter=NO_FILTER)


@pytest.mark.parametrize(
    ("release", "revision", "angle"),
    [((0, 84), 85, 0.601), ((0, 90), 92, 0.451), ((2, 8), 103, 0.451), ((2, 12), 106, 0.451)],
)
def test_a_set_that_cannot_be_read_is_taken_for_the_one_that_a_release_is_shipped_with(release, revision, angle):
    dialect = replace(Dialect(), fc_release=Release(*release))
    assumed = assumed_model(dialect)
    shipped = aircraft_model(ParameterSet.from_payload(factory_set(revision, 3)), dialect, has_slow_leak=False)
    assert math.degrees(assumed.rad_per_count) == pytest.approx(angle, abs=0.001)
    for name in ("rad_per_count", "a1", "a2", "yaw_linear", "yaw_square"):
        assert getattr(assumed, name) == pytest.approx(getattr(shipped, name), rel=0.01), name


@pytest.mark.parametrize("name", ["gyro_i", "gyro_stability", "stick_p", "stick_yaw_p"])
def test_a_parameter_that_makes_no_aircraft_is_named_with_its_value(name):
    assert model(**{name: 0}) == ModelUnknown(Gap.NO_AIRCRAFT, name, 0)


@pytest.mark.parametrize("value", [248, 251, 255])
@pytest.mark.parametrize("name", EASY)
def test_a_gain_on_a_potentiometer_is_no_gain(name, value):
    assert model(**{name: value}) == ModelUnknown(Gap.ON_POTENTIOMETER, name, value, 256 - value)
    assert isinstance(model(**{name: 247}), AircraftModel)


def test_a_set_that_says_too_little_is_unread():
    unknown = ParameterSet.from_payload(bytes([200]) + bytes(146))
    assert aircraft_model(unknown, Dialect(), has_slow_leak=False) == ModelUnknown(Gap.UNREAD)
    old = ParameterSet.from_payload(bytes([73]) + bytes(layout_of(73).size - 1))
    assert aircraft_model(old, Dialect(), has_slow_leak=False) == ModelUnknown(Gap.UNREAD, "gyro_stability")


GAINS = st.fixed_dictionaries({name: st.integers(0, 255) for name in EASY})


@given(GAINS, st.booleans(), st.booleans())
def test_every_set_gives_a_model_or_says_which_parameter_prevents_it(gains, has_filter, has_slow_leak):
    found = model(has_filter=has_filter, has_slow_leak=has_slow_leak, **gains)
    if isinstance(found, ModelUnknown):
        assert gains[found.parameter] == found.value
        assert found.value == 0 or found.poti == 256 - found.value
    else:
        assert all(math.isfinite(number) and number > 0.0 for number in astuple(found))

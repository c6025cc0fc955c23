"""The model of the aircraft from its own parameter set."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mkdaemon.control.estimator.model import LEAK_FAST, LEAK_SLOW, NO_FILTER, STICK_FILTER, AircraftModel
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.translate import aircraft_model, assumed_model

EASY = {"stick_p": 6, "gyro_p": 100, "gyro_i": 120, "integral_factor": 16, "gyro_stability": 6, "stick_yaw_p": 4}
"""The factory's first set; its angle a count and its gains are those of docs/control.md."""


def parameters(revision=106, **changes):
    return ParameterSet.from_payload(bytes([revision]) + bytes(143)).replaced({**EASY, **changes})


def model(*, has_filter=True, has_slow_leak=False, **changes):
    dialect = replace(Dialect(), stick_filter=has_filter)
    return aircraft_model(parameters(**changes), dialect, has_slow_leak=has_slow_leak)


def test_the_easy_set_gives_the_documented_constants():
    found = model()
    assert math.degrees(found.rad_per_count) == pytest.approx(0.451, abs=0.001)
    assert found.a1 == pytest.approx(3.10, abs=0.01)
    assert found.a2 == pytest.approx(3.33, abs=0.02)
    assert (found.stick_filter, found.leak) == (STICK_FILTER, LEAK_FAST)


def test_firmware_and_navictrl_decide_filter_and_leak():
    assert model(has_filter=False).stick_filter == NO_FILTER
    assert model(has_slow_leak=True).leak == LEAK_SLOW


def test_an_aircraft_whose_set_cannot_be_read_is_taken_for_easy_on_its_own_firmware():
    assert assumed_model(replace(Dialect(), stick_filter=True)) == AircraftModel()
    assert assumed_model(Dialect()) == replace(AircraftModel(), stick_filter=NO_FILTER)


@pytest.mark.parametrize("changes", [{"gyro_i": 0}, {"gyro_stability": 0}])
def test_a_set_without_angle_feedback_has_no_model(changes):
    assert model(**changes) is None


def test_an_unknown_revision_has_no_model():
    unknown = ParameterSet.from_payload(bytes([200]) + bytes(146))
    assert aircraft_model(unknown, Dialect(), has_slow_leak=False) is None

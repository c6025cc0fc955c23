"""Margins of the horizontal loop, as they are shown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.guidance.margins import NAMES, gains_of


def test_the_loop_bears_the_stick_gains_and_delays_that_flights_bore():
    found = gains_of(AircraftModel(), 0.35)
    assert tuple(found.gains) == NAMES
    assert found.radius < 1.0
    low, high = found.gain_margin
    assert low < 0.67
    assert high > 1.33
    assert 0.02 <= found.delay_margin < 0.48


def test_the_model_that_is_shown_is_the_one_that_is_flown_on():
    found = gains_of(replace(AircraftModel(), a1=3.41, a2=7.1), 0.35)
    assert (found.a1, found.a2) == (3.41, 7.1)
    assert found.gains["position"] != pytest.approx(gains_of(AircraftModel(), 0.35).gains["position"])

"""What the flight core says of a model that the aircraft does not follow."""

from __future__ import annotations

import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import Warn
from mkdaemon.control.authority import Authority
from mkdaemon.control.output import StickOutput
from mkdaemon.control.reports import Reports
from mkdaemon.control.vehicle import VehicleFacts, VehicleMemory
from mkdaemon.telemetry.control import EstimateValue
from tests.control.admission.situations import eyes, heights

CFG = ControlConfig()


def believed(**fields):
    return EstimateValue.model_construct(**{"stick_filter": 0.078, "stick_gain": 1.0, **fields})


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"stick_filter": 0.004}, "the stick filter is 4 ms, and not 78 ms"),
        ({"stick_gain": 1.49}, "1.49 times that of its parameter set, and not 1.00 times"),
    ],
)
def test_an_answer_to_the_sticks_that_is_not_the_models_is_told_once_with_both_numbers(fields, words):
    facts = VehicleFacts()
    authority = Authority(CFG, first_epoch=1, guide=lambda setpoint, now, is_flying: None)
    reports = Reports(authority, StickOutput(CFG, facts), facts, lambda now: None)
    for value in (believed(), believed(stick_gain=1.04), believed(**fields), believed(**fields)):
        reports.estimate(value, None)
    [warning] = [action for action in reports.take() if isinstance(action, Warn)]
    assert words in warning.text


def test_heights_that_the_barometer_contradicts_are_told_once_with_their_scale():
    facts = VehicleMemory()
    authority = Authority(CFG, first_epoch=1, guide=lambda setpoint, now, is_flying: None)
    reports = Reports(authority, StickOutput(CFG, facts), facts, lambda now: None)
    for odds in (0.0, 1.9, 2.1, 5.0, 5.0):
        facts.eye_reported(eyes(selfcal=(heights(20.0, sd=4.0, covered=2.5, odds=odds),)))
        reports.eyes_reported()
    [warning] = reports.take()
    assert "2.00 +- 0.10 m by the barometer" in warning.text
    assert "+20 % off" in warning.text

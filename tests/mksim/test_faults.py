"""The fault table and its running state."""

from __future__ import annotations

import math

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.sim_faults import FAULTS, FaultNumber
from mksim.faults import RunningFaults


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_explains_itself_starts_and_stops(name: str) -> None:
    spec, faults = FAULTS[name], RunningFaults()
    assert spec.effect.endswith(".")
    for parameter in spec.parameters.values():
        assert parameter.help
        if isinstance(parameter, FaultNumber):
            assert parameter.low <= parameter.default <= parameter.high
        else:
            assert parameter.default in parameter.choices
    for change, is_active in ((faults.start, True), (faults.stop, False)):
        before = faults.generation
        change(name)
        assert faults.is_active(name) is is_active
        assert faults.generation > before
    faults.stop(name)


@pytest.mark.parametrize(
    ("name", "values", "token", "says"),
    [
        ("motor_week", {}, "unknown_fault", "motor_weak"),
        ("gps_lost", {"deg": 1.0}, "unknown_parameter", "none"),
        ("motor_weak", {"part": 1.0}, "unknown_parameter", "share"),
        ("motor_weak", {"motor": 5.0}, "out_of_range", "1 to 4"),
        ("motor_weak", {"motor": 1.5}, "out_of_range", "a whole number from 1 to 4"),
        ("motor_weak", {"share": "much"}, "out_of_range", "0 to 1"),
        ("motor_weak", {"share": math.nan}, "out_of_range", "0 to 1"),
        ("wind_gust", {"speed": 99.0}, "out_of_range", "0 to 15 m/s"),
        ("link_cut", {"direction": "sideways"}, "out_of_range", "to_board"),
        ("gps_lost", {"duration": -1.0}, "out_of_range", "above 0 s"),
        ("gps_lost", {"duration": math.nan}, "out_of_range", "above 0 s"),
    ],
)
def test_mistakes_are_refused_with_the_fix(name: str, values: dict[str, float], token: str, says: str) -> None:
    faults = RunningFaults()
    with pytest.raises(CommandRejectedError) as refusal:
        faults.start(name, **values)
    assert refusal.value.token == token
    assert says in refusal.value.fix
    assert not faults.active


def test_a_fault_ends_by_itself() -> None:
    faults = RunningFaults()
    faults.advance(10.0)
    faults.start("gps_lost", duration=2.0)
    faults.start("rc_lost")
    faults.start("wind_gust")
    faults.advance(11.99)
    assert faults.is_active("gps_lost")
    before = faults.generation
    faults.advance(12.0)
    assert list(faults.active) == ["rc_lost"]
    assert faults.generation > before
    faults.clear()
    assert not faults.active

"""Every parameter of every accepted item is used, told, or refused by name."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.missions import FORMATS
from mkdaemon.missions.items import ARDUPILOT, COMMANDS, GENERIC, PX4, Otherwise
from mkdaemon.missions.source import MissionDraft

READ = FORMATS[".plan"].read
WAY = {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, 53.1, 8.1, 20], "autoContinue": True}
HIGH = {**WAY, "params": [0, 0, 0, None, 53.2, 8.2, 40]}
LOW = {**WAY, "params": [0, 0, 0, None, 53.3, 8.3, 30]}
VALID: dict[int, list[Any]] = {
    16: [3, 4, 0, 90, 53.15, 8.15, 25],
    19: [3, 0, 0, None, 53.15, 8.15, 25],
    20: [0, 0, 0, 0, 0, 0, 0],
    21: [0, 0, 0, 90, 53.15, 8.15, 25],
    22: [0, 0, 0, 90, 53.15, 8.15, 25],
    178: [1, 4, -1, 0, 0, 0, 0],
    195: [0, 0, 0, 0, 53.15, 8.15, 5],
    197: [0, 0, 0, 0, 0, 0, 0],
    201: [3, 0, 0, 0, 53.15, 8.15, 5],
    205: [-30, 0, 0, 0, 0, 0, 2],
    206: [10, 0, 0, 0, 0, 0, 0],
}
"""An item of each command that is read."""
VALUES = (-1.0, -0.0, 0.4, 1.0, 2.0, 7.0, 33.0, -123.456, 1e-300, 1e9, -1.7e308, math.nan, math.inf, -math.inf)
"""What a parameter is changed to."""
READ_OTHERWISE = (0, 3)
"""Parameters that ArduPilot and PX4 read in ways of their own: a kind or mode, and the yaw."""


def item(command: int, params: list[Any], **fields: Any) -> dict[str, Any]:
    return {**WAY, "command": command, "params": params, **fields}


def drafted(*items: dict[str, Any], autopilot: int = GENERIC, **beside: Any) -> MissionDraft:
    plan = {"fileType": "Plan", "mission": {"firmwareType": autopilot, "items": list(items)}, **beside}
    return READ(json.dumps(plan), "a.plan")


def around(it: dict[str, Any]) -> list[dict[str, Any]]:
    """A mission with an item that is not the first, except a take-off, nor the last, except a return."""
    if it["command"] in (20, 22):
        return [it, HIGH, LOW] if it["command"] == 22 else [HIGH, LOW, it]
    return [WAY, it, HIGH, LOW]


@pytest.mark.parametrize("autopilot", [GENERIC, ARDUPILOT, PX4])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_changed_parameter_changes_the_mission_or_is_refused_or_told(command: int, autopilot: int) -> None:
    plain = drafted(*around(item(command, VALID[command])), autopilot=autopilot)
    for index in range(7) if autopilot == GENERIC else READ_OTHERWISE:
        for value in VALUES:
            check_changed(plain, command, index, value, autopilot)


def check_changed(plain: MissionDraft, command: int, index: int, value: float, autopilot: int) -> None:
    param = COMMANDS[command].params[index]
    params = [*VALID[command]]
    if params[index] == value or (params[index] is None and math.isnan(value)):
        return
    params[index] = value
    try:
        found = drafted(*around(item(command, params)), autopilot=autopilot)
    except ConfigError as error:
        assert str(error).startswith("a.plan:1: ")
        assert "Error" not in str(error)
        return
    if param.field and not math.isnan(value):
        # What a field takes is at most rounded to its step.
        same = found.mission == plain.mission and found.notes == plain.notes
        steps = {"latitude_deg": 1e-6, "longitude_deg": 1e-6, "altitude": 1e-3}
        close = abs(value - (VALID[command][index] or 0)) <= steps.get(param.field, 1.0)
        assert not same or close or value in {*param.nothing, 0.0, 1.0, 3.0}
    elif param.otherwise is Otherwise.NOTED and value not in (0.0, *param.nothing) and not math.isnan(value):
        assert any(param.word in note for note in found.notes)
    elif param.otherwise is not Otherwise.NOTHING:
        assert value in param.nothing or math.isnan(value) or param.otherwise is Otherwise.NOTED


def test_speeds_of_climb_and_descent_are_rates_of_climb_of_what_follows() -> None:
    draft = drafted(
        item(178, [1, 4, -1, 0, 0, 0, 0]), WAY, item(178, [2, 1.5, -1, 0, 0, 0, 0]), HIGH,
        item(178, [3, 0.5, -1, 0, 0, 0, 0]), LOW, HIGH,
    )  # fmt: skip
    assert [(p.speed, p.climb) for p in draft.mission.points] == [(4, 3), (4, 1.5), (4, 0.5), (4, 1.5)]
    assert READ(FORMATS[".plan"].write(draft.mission), "b.plan").mission.points == draft.mission.points


@pytest.mark.parametrize(
    ("command", "params", "says"),
    [
        (178, [0, 4, -1, 0, 0, 0, 0], "kind of speed 0 of command 178"),
        (178, [1, 4, -1, 1, 0, 0, 0], "relative speed 1"),
        (178, [1, 0, 50, 0, 0, 0, 0], "throttle 50"),
        (178, [1, 0, -1, 0, 0, 0, 0], "speed 0 "),
        (201, [1, 0, 0, 0, 0, 0, 0], "mode 1 of command 201"),
        (201, [2, 3, 0, 0, 0, 0, 0], "waypoint index 3"),
        (201, [4, 0, 0, 0, 0, 0, 0], "mode 4"),
        (205, [30, 0, 0, 0, 0, 0, 2], "pitch 30 of command 205"),
        (205, [-30, 0, 90, 0, 0, 0, 2], "yaw 90"),
        (205, [-45, 0, 0, 0, 0, 0, 0], "mode 0"),
        (205, [0, 0, 0, 5, 53.2, 8.2, 4], "altitude 5"),
        (16, [0, -3, 0, None, 53.1, 8.1, 20], "acceptance radius -3"),
        (16, [0, 0, 5, None, 53.1, 8.1, 20], "pass radius 5"),
        (16, [math.inf, 0, 0, None, 53.1, 8.1, 20], "hold time is infinite"),
        (16, [10**400, 0, 0, None, 53.1, 8.1, 20], "hold time is infinite"),
        (16, [0, 0, 0, -math.inf, 53.1, 8.1, 20], "yaw is infinite"),
        (16, [0, 0, 0, None, math.nan, 8.1, 20], "latitude is not given"),
        (178, [1, math.inf, -1, 0, 0, 0, 0], "speed is infinite"),
        (178, [math.nan, 4, -1, 0, 0, 0, 0], "kind of speed is not given"),
        (206, [-5, 0, 0, 0, 0, 0, 0], "distance -5"),
    ],
)
def test_what_a_point_cannot_say_is_refused_by_name(command: int, params: list[Any], says: str) -> None:
    with pytest.raises(ConfigError, match=rf"^a\.plan:1: {says}"):
        drafted(item(command, params), WAY)


def test_ardupilot_looks_at_a_place_without_a_mode_and_cancels_without_a_place() -> None:
    look = item(201, [0, 0, 0, 0, 53.2, 8.2, 5])
    draft = drafted(look, WAY, item(195, [0] * 7), HIGH, autopilot=ARDUPILOT)
    assert [point.poi for point in draft.mission.points] == [None, 1, None]
    with pytest.raises(ConfigError, match="0 N 0 E"):
        drafted(item(195, [0] * 7), WAY)


def test_a_mission_that_waits_is_refused_except_where_the_word_is_not_read() -> None:
    waits = [{**WAY, "autoContinue": False}, {**HIGH, "autoContinue": False}]
    with pytest.raises(ConfigError, match="wait here"):
        drafted(waits[0], HIGH)
    draft = drafted(*waits, autopilot=ARDUPILOT)
    assert len(draft.mission.points) == 2
    assert draft.notes == ("a.plan:1: autoContinue is false, and ArduPilot goes on all the same",)

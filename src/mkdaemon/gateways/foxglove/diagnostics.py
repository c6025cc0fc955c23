"""What is well and what is not, for the diagnostics panels of Foxglove and Lichtblick.

They know ROS's DiagnosticArray by the name of its schema, whatever it is encoded in.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import IntEnum
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar, cast

from foxglove import Schema

from mkdaemon.gateways.foxglove.names import Names, time_ns
from mkdaemon.record.entry import NANOSECONDS
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlStatus, Tone
from mkdaemon.telemetry.link import LinkCondition, LinkHealth
from mkdaemon.telemetry.preflight import Blocks, CheckState, ControlPreflight, Finding
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.state import Battery, Flight
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import EyeState, VisionStats

_Value = TypeVar("_Value", bound=Stamped)


class Level(IntEnum):
    """Of ROS's DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


class Status(NamedTuple):
    """One line of a diagnostics panel.

    Attributes:
        name: what it is about.
        level: how bad it is.
        message: in words.
        values: makes what it stands on; only for a line that is shown.
    """

    name: str
    level: Level
    message: str
    values: Callable[[], Mapping[str, str]]

    @property
    def gist(self) -> tuple[Level, str]:
        """What has to change to be shown at once: the level, and the message without its numbers."""
        return self.level, _NUMBER.sub("", self.message)


_NUMBER: Final = re.compile(r"[-+.\d]+")
PERIOD: Final = 1.0
"""Between two messages while nothing changes [s]."""


def _vehicle(value: VehicleHealth) -> Status:
    level = Level.OK if value.is_alive and value.error is None else Level.ERROR
    return Status("vehicle", level, value.error or value.reason, partial(_values, value))


def _link(value: LinkHealth) -> Status:
    condition = value.state.condition
    half = Level.WARN if condition.hears_board else Level.ERROR
    level = Level.OK if condition is LinkCondition.UP else half
    return Status("link", level, f"{condition}: {value.state.reason}", partial(_values, value))


def _control(value: ControlStatus) -> Status:
    level = Level.ERROR if value.trouble else _LEVELS[value.phase.tone]
    return Status("control", level, value.trouble or f"{value.phase}: {value.reason}", partial(_values, value))


_LEVELS: Final = {Tone.NOTE: Level.OK, Tone.OK: Level.OK, Tone.WARN: Level.WARN, Tone.BAD: Level.ERROR}


def _battery(value: Battery) -> Status:
    level = Level.ERROR if value.is_low else Level.OK
    return Status("battery", level, f"{value.voltage:.1f} V{', LOW' if value.is_low else ''}", partial(_values, value))


def _flight(value: Flight) -> Status:
    alarms = [name.replace("_", " ") for name in _ALARMS if getattr(value, name)]
    alarms += [value.error] if value.error_code else []
    return Status(
        "flight", Level.ERROR if alarms else Level.OK, ", ".join(alarms) or "no alarm", partial(_values, value)
    )


_ALARMS: Final = ("emergency_landing", "battery_low", "rc_failsafe", "range_limit", "serial_link_lost")


def _camera(value: VisionStats) -> Status:
    is_ok = value.state is EyeState.OK
    level = Level.ERROR if not is_ok else Level.WARN if value.alarms else Level.OK
    words = "; ".join([f"{value.state}: {value.reason}".removesuffix(": "), *value.alarms.values()])
    return Status(f"camera {value.camera}", level, words, partial(_values, value))


def _recorder(value: RecordStatus) -> Status:
    is_well = value.state in {RecorderState.RECORDING, RecorderState.OFF}
    level = Level.ERROR if not is_well else Level.WARN if value.lost else Level.OK
    return Status("recorder", level, f"{value.state}: {value.reason}".removesuffix(": "), partial(_values, value))


def _finding(found: Finding) -> Status:
    bad = Level.WARN if found.blocks is Blocks.NOTHING else Level.ERROR
    level = {CheckState.PASSED: Level.OK, CheckState.UNKNOWN: Level.WARN, CheckState.STANDS: bad}[found.state]
    words = f"{found.reason} {found.fix}".strip()
    return Status(f"preflight: {found.name}", level, words, partial(dict, state=found.state, blocks=found.blocks))


def _one(make: Callable[[_Value], Status]) -> Callable[[Stamped], list[Status]]:
    return lambda value: [make(cast("_Value", value))]


_STATUSES: Final[dict[type[Stamped], Callable[[Any], list[Status]]]] = {
    VehicleHealth: _one(_vehicle),
    LinkHealth: _one(_link),
    ControlStatus: _one(_control),
    Battery: _one(_battery),
    Flight: _one(_flight),
    VisionStats: _one(_camera),
    RecordStatus: _one(_recorder),
    ControlPreflight: lambda value: [_finding(found) for found in value.findings],
}
KEYS: Final = (
    *("health", "link/health", "control/status", "state/battery", "state/flight"),
    *("vision/*/stats", "record/status", "control/preflight"),
)
"""Keys of the values above."""

_TIME: Final = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_TEXT: Final = {"type": "string"}
_PAIR: Final = {"type": "object", "properties": {"key": _TEXT, "value": _TEXT}}
_STATUS: Final = {
    "type": "object",
    "properties": {
        "level": {"type": "integer"},
        **dict.fromkeys(("name", "message", "hardware_id"), _TEXT),
        "values": {"type": "array", "items": _PAIR},
    },
}
_ARRAY: Final = {
    "type": "object",
    "properties": {
        "header": {"type": "object", "properties": {"stamp": _TIME, "frame_id": _TEXT}},
        "status": {"type": "array", "items": _STATUS},
    },
}


def schema() -> Schema:
    """The schema, by the name that the panels look for."""
    return Schema(name="diagnostic_msgs/DiagnosticArray", encoding="jsonschema", data=json.dumps(_ARRAY).encode())


class Diagnostics:
    """What the values of a vehicle say about the health of its parts: once a second, and at once what changes."""

    def __init__(self, names: Names) -> None:
        """Have shown nothing yet.

        Args:
            names: of the vehicle.
        """
        self._names = names
        self._gists: dict[str, tuple[Level, str]] = {}
        self._waiting: dict[str, Status] = {}
        self._shown = float("-inf")

    def __call__(self, suffix: str, value: Stamped) -> bytes | None:
        """The lines that came since the last message; None where they wait, and for a value of no such part."""
        make = _STATUSES.get(type(value))
        if make is None:
            return None
        found = {one.name: one for one in make(value)}
        gists = {name: one.gist for name, one in found.items()}
        is_new = not gists.items() <= self._gists.items()
        self._gists |= gists
        self._waiting |= found
        at = value.stamp.monotonic
        if not is_new and 0.0 <= at - self._shown < PERIOD:
            return None
        self._shown = at
        lines, self._waiting = list(self._waiting.values()), {}
        return _message(self._names, value, lines)


def _message(names: Names, value: Stamped, lines: Iterable[Status]) -> bytes:
    sec, nsec = divmod(time_ns(value.stamp), NANOSECONDS)
    shown = {
        "header": {"stamp": {"sec": sec, "nsec": nsec}, "frame_id": names.body},
        "status": [
            {
                "level": int(one.level),
                "name": one.name,
                "message": one.message,
                "hardware_id": names.vehicle,
                "values": [{"key": key, "value": text} for key, text in one.values().items()],
            }
            for one in lines
        ],
    }
    return json.dumps(shown).encode()


def _values(value: Stamped) -> dict[str, str]:
    """Every number, truth and text of a value by its path; lists, stamps and what is not known are left out."""
    return dict(_leaves(value.model_dump(mode="json"), ""))


def _leaves(part: Mapping[str, Any], head: str) -> Iterator[tuple[str, str]]:
    for name, one in part.items():
        if isinstance(one, dict):
            if "monotonic" not in one:  # no stamp: a time is no measure of health
                yield from _leaves(one, f"{head}{name}.")
        elif one is not None and not isinstance(one, list):
            yield f"{head}{name}", f"{one:.6g}" if isinstance(one, float) else str(one)

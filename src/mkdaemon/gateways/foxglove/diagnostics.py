"""What is well and what is not, for the diagnostics panels of Foxglove and Lichtblick.

They know ROS's DiagnosticArray by the name of its schema, whatever it is encoded in.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import Final

from foxglove import Schema
from pydantic_core import to_json

from mkdaemon.gateways.foxglove.names import Names, time_ns
from mkdaemon.reading import Reading
from mkdaemon.reading.diagnoses import PARTS, VERDICT, Diagnosis, DiagnosticLevel, diagnoses_of, diagnosis_of, states_of
from mkdaemon.reading.known import KEYS as PICTURED
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.preflight import ControlPreflight

_NUMBER: Final = re.compile(r"[-+.\d]+")
PERIOD: Final = 1.0
"""Between two messages while nothing changes [s]."""
LOOK_PERIOD: Final = 0.2
"""Between two searches for a change of what is known [s]: one takes as long as ten values."""
_SHOWN_BY: Final = frozenset(PARTS.values())
KEYS: Final = (*PICTURED, "control/preflight")
"""Keys of the values that are diagnosed."""


def schema() -> Schema:
    """The schema, by the name that the panels look for: the shape of a message with a line."""
    line = Diagnosis("", DiagnosticLevel.OK, "", {"": ""})
    shape = json.dumps(_shape(_document(Names(""), 0, [line])))
    return Schema(name="diagnostic_msgs/DiagnosticArray", encoding="jsonschema", data=shape.encode())


def _shape(part: object) -> dict[str, object]:
    """The JSON Schema of a value."""
    if isinstance(part, dict):
        return {"type": "object", "properties": {name: _shape(value) for name, value in part.items()}}
    if isinstance(part, list):
        return {"type": "array", "items": _shape(part[0])}
    return {"type": "string" if isinstance(part, str) else "integer"}


class Diagnostics:
    """What the values of a vehicle say about the health of its parts: once a second, and what changes with it."""

    def __init__(self, names: Names) -> None:
        """Have shown nothing yet.

        Args:
            names: of the vehicle.
        """
        self._names = names
        self._reading = Reading()
        self._gists: dict[str, tuple[DiagnosticLevel, str]] = {}
        self._shown = self._looked = float("-inf")
        self._fresh: set[str] = set()

    def __call__(self, suffix: str, value: Stamped) -> bytes | None:
        """Every line that is known; None where nothing has changed, and for a value of no such part."""
        if isinstance(value, ControlPreflight):
            return _message(self._names, value, map(diagnosis_of, value.findings))
        at = value.stamp.monotonic
        self._reading.take(suffix, value, at)
        if suffix not in _SHOWN_BY and not suffix.endswith("/stats"):
            return None
        if suffix in self._fresh and 0.0 <= at - self._looked < LOOK_PERIOD:
            return None
        picture = self._reading.at(at)
        states = list(states_of(picture))
        self._looked, self._fresh = at, {one.key for one in states if one.level is not DiagnosticLevel.STALE}
        # What has to change to be shown: the level, and the message without its numbers.
        gists = {one.name: (one.level, _NUMBER.sub("", one.message)) for one in states}
        if gists == self._gists and 0.0 <= at - self._shown < PERIOD:
            return None
        self._gists, self._shown = gists, at
        lines = (line for line in diagnoses_of(picture) if line.values or line.name == VERDICT)
        return _message(self._names, value, lines)


def _message(names: Names, value: Stamped, lines: Iterable[Diagnosis]) -> bytes:
    return to_json(_document(names, time_ns(value.stamp), lines))


def _document(names: Names, time: int, lines: Iterable[Diagnosis]) -> dict[str, object]:
    """A DiagnosticArray of a time [ns; Unix time]."""
    sec, nsec = divmod(time, NANOSECONDS)
    return {
        "header": {"stamp": {"sec": sec, "nsec": nsec}, "frame_id": names.body},
        "status": [
            {
                "level": int(one.level),
                "name": one.name,
                "message": one.message,
                "hardware_id": names.vehicle,
                "values": [{"key": key, "value": _text(found)} for key, found in one.values.items()],
            }
            for one in lines
        ],
    }


def _text(value: object) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)

"""A whole recording at a glance: what was flown, and what happened, on the daemon's clock."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final

from mkdaemon.reading import EventLine, line_of
from mkdaemon.telemetry.control import ControlStatus, Phase

MOST: Final = 500
"""Parts, and marks; the first are kept."""


@dataclass(frozen=True, slots=True)
class FlownPart:
    """What was flown for a while.

    Attributes:
        begin: [s; the daemon's monotonic].
        text: the manoeuvre; the phase where there is none; empty while no client held the lease.
    """

    begin: float
    text: str


@dataclass(frozen=True, slots=True)
class Overview:
    """A whole recording.

    Attributes:
        parts: each until the next one begins.
        marks: what happened, in order.
    """

    parts: tuple[FlownPart, ...]
    marks: tuple[EventLine, ...]

    def as_map(self, zero: float) -> dict[str, Any]:
        """For the page, in seconds since the recording's beginning.

        Args:
            zero: the beginning [s; the daemon's monotonic].
        """
        parts = [{"begin": part.begin - zero, "text": part.text} for part in self.parts]
        return {"parts": parts, "marks": [asdict(mark) | {"at": mark.at - zero} for mark in self.marks]}


def overview_of(values: Iterable[object]) -> Overview:
    """The overview of all statuses and events of a recording, those of a kind in order."""
    parts: list[FlownPart] = []
    marks: list[EventLine] = []
    for value in values:
        if isinstance(value, ControlStatus):
            text = "" if value.phase is Phase.FREE else (value.manoeuvre or value.phase.value)
            if not parts or parts[-1].text != text:
                parts.append(FlownPart(value.stamp.monotonic, text))
        elif (line := line_of(value)) is not None:
            marks.append(line)
    marks.sort(key=lambda line: line.at)
    return Overview(tuple(parts[:MOST]), tuple(marks[:MOST]))

"""Events as lines of a log: what happened, in words, and what to do about a refusal."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from mkdaemon.telemetry.event import ClockEvent, CommandEvent, FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.mission import MissionEvent
from mkdaemon.telemetry.procedure import ProcedureProgress
from mkdaemon.telemetry.record import MarkEvent
from mkdaemon.telemetry.status import Status

_GOOD = frozenset({Status.ACCEPTED, Status.NOT_OBSERVABLE})
_LEVELS = {"warning": "warn", "error": "bad", "critical": "bad"}


@dataclass(frozen=True, slots=True)
class EventLine:
    """One line.

    Attributes:
        at: when, on the daemon's clock [s].
        wall: when [s; Unix time].
        tone: `ok`, `note`, `warn` or `bad`.
        text: what happened.
        fix: what to do about it; empty for nothing.
    """

    at: float
    wall: float
    tone: str
    text: str
    fix: str = ""

    def as_map(self) -> dict[str, Any]:
        """For the page."""
        return asdict(self)


def line_of(event: object) -> EventLine | None:
    """An event in words; None for what is none."""
    tone, text, fix = "note", "", ""
    match event:
        case CommandEvent():
            is_good = event.status in _GOOD
            tone = "ok" if is_good else "bad"
            why = f": {event.reason}" if event.reason else ""
            text, fix = f"{event.key} {event.status}{'' if is_good else why}", event.fix or ""
        case ModeEvent():
            text = f"{event.before} → {event.after}: {event.reason}"
        case FailsafeEvent():
            confirmed = {True: ", confirmed", False: ", NOT confirmed", None: ""}[event.released]
            tone, text = "bad", f"the daemon let go by itself ({event.action}{confirmed}): {event.reason}"
        case MissionEvent():
            tone = "bad" if event.action == "incomplete" else "note"
            text = f"waypoint list {event.action}, {event.count} points"
        case ProcedureProgress():
            tone = "bad" if event.token else "note"
            text = f"{event.verb} {event.step} of {event.of}, {event.state}: {event.text}"
        case ClockEvent():
            tone, text = "warn", f"the system clock was set by {event.step:+.1f} s"
        case MarkEvent():
            text = f"mark by {event.holder or 'somebody'}: {event.text}"
        case LogEvent():
            tone, text = _LEVELS.get(event.level, "note"), event.text
        case _:
            return None
    return EventLine(event.stamp.monotonic, event.stamp.wall, tone, text, fix)

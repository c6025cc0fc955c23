"""Events as lines of a log: what happened, in words, how bad it is, and what to do about a refusal."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Final

from mkdaemon.spelling import on_one_line
from mkdaemon.telemetry.event import ClockEvent, CommandEvent, FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.mission import MissionEvent
from mkdaemon.telemetry.procedure import ProcedureProgress
from mkdaemon.telemetry.record import MarkEvent
from mkdaemon.telemetry.status import Status
from mkdaemon.telemetry.tone import Tone

_GOOD: Final = frozenset({Status.ACCEPTED, Status.NOT_OBSERVABLE})
_LEVELS: Final = {"warning": Tone.WARN, "error": Tone.BAD, "critical": Tone.BAD}
_CONFIRMED: Final = {True: ", confirmed", False: ", NOT confirmed", None: ""}
_SECRETS: Final = frozenset({"epoch", "sequence", "ttl", "secret", "echo"})
"""Fields of a command that say nothing of what was asked."""


class Sort(StrEnum):
    """What an event is; the value is what is shown."""

    COMMAND = "command"
    REFUSAL = "refusal"
    MODE = "mode"
    FAILSAFE = "failsafe"
    LOG = "log"
    WARNING = "warning"
    MARK = "mark"
    PROCEDURE = "procedure"
    MISSION = "mission"
    CLOCK = "clock"
    LINE = "line"


@dataclass(frozen=True, slots=True)
class EventLine:
    """One line.

    Attributes:
        at: when, on the daemon's clock [s].
        wall: when [s; Unix time].
        sort: what it is.
        tone: how bad it is.
        text: what happened.
        token: of a refusal; empty for none.
        fix: what to do about it; empty for nothing.
    """

    at: float
    wall: float
    sort: Sort
    tone: Tone
    text: str
    token: str = ""
    fix: str = ""

    def as_map(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @property
    def is_routine(self) -> bool:
        """Nothing to look at while a flight goes well: an accepted command, a line of the log."""
        return self.sort in (Sort.COMMAND, Sort.LOG, Sort.PROCEDURE) and not self.tone.is_wrong


def line_of(event: object) -> EventLine | None:
    """An event in words; None for what is none."""
    sort, tone, token, fix = Sort.LOG, Tone.NOTE, "", ""
    match event:
        case CommandEvent():
            is_good = event.status in _GOOD
            sort, tone = (Sort.COMMAND, Tone.OK) if is_good else (Sort.REFUSAL, Tone.BAD)
            text, token, fix = _command(event, is_good=is_good), event.token or "", event.fix or ""
        case ModeEvent():
            sort, text = Sort.MODE, f"{event.before} -> {event.after}: {event.reason}"
        case FailsafeEvent():
            sort, tone = Sort.FAILSAFE, Tone.BAD
            text = f"FAILSAFE {event.action}{_CONFIRMED[event.released]}: {event.reason}"
        case MissionEvent():
            sort, tone = Sort.MISSION, Tone.BAD if event.action == "incomplete" else Tone.NOTE
            text = f"waypoint list {event.action}, {event.count} points"
        case ProcedureProgress():
            sort, tone = Sort.PROCEDURE, Tone.BAD if event.token else Tone.NOTE
            text = f"{event.verb} {event.step} of {event.of}, {event.state}: {event.text}"
        case ClockEvent():
            sort, tone, text = Sort.CLOCK, Tone.WARN, f"the system clock was set by {event.step:+.3f} s"
        case MarkEvent():
            sort, text = Sort.MARK, f"mark by {event.holder or 'unknown'}: {event.text}"
        case LogEvent():
            tone, text = _LEVELS.get(event.level, Tone.NOTE), event.text
            sort = Sort.WARNING if tone.is_wrong else Sort.LOG
        case _:
            return None
    return EventLine(event.stamp.monotonic, event.stamp.wall, sort, tone, on_one_line(text), token, on_one_line(fix))


def _command(event: CommandEvent, *, is_good: bool) -> str:
    carried = (f"{name} {value}" for name, value in event.fields.items() if value is not None and name not in _SECRETS)
    what = ", ".join(carried)
    words = f"{event.key} ({what})" if what else event.key
    return words if is_good else f"{words} {event.status}: {event.reason or 'refused'}"

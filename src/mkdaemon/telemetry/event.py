"""The audit trail under `event/`: requests, decisions, observations."""

from typing import Any

from mkdaemon.telemetry.base import Stamped


class CommandEvent(Stamped):
    """A command or the first setpoint of an epoch, and what became of it: `event/command`."""

    key: str
    """Key it came by, without `mk/<vehicle>/`."""
    fields: dict[str, Any]
    """What it carried."""
    status: str
    """How it ended; see `CommandResult`."""
    token: str | None = None
    """Stable word of a refusal."""
    reason: str | None = None
    """Why it was refused."""
    fix: str | None = None
    """What to do about it."""
    duration: float | None = None
    """Time it took [s]."""


class ModeEvent(Stamped):
    """Authority or flight mode changed: `event/mode`."""

    before: str
    """Phase or mode until now."""
    after: str
    """Phase or mode from now on."""
    reason: str
    """Why."""


class FailsafeEvent(Stamped):
    """The ladder of docs/safety.md took a step on its own: `event/failsafe`."""

    action: str
    """What was done: `neutral`, `release`."""
    reason: str
    """Why."""
    released: bool | None = None
    """Whether the board confirmed the release; null where it cannot."""


class LogEvent(Stamped):
    """Something worth a line in a log: `event/log`."""

    level: str
    """info, warning or error."""
    text: str
    """One sentence."""


class ClockEvent(Stamped):
    """The system clock was set: wall times before it and after it do not fit together. `event/clock`."""

    step: float
    """How far it jumped against the monotonic clock, forward positive [s]."""
    suspended: float
    """How much of that the machine slept [s]."""

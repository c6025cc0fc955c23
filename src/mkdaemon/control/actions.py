"""Actions of the flight core: small frozen values that the daemon carries out in order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mkdaemon.control.limiter import StickCounts, Sticks
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.control import ErrorValue, EstimateValue, Phase, StatusValue
from mkdaemon.telemetry.navi import NaviFlight
from mkdaemon.telemetry.path import PathProgress


@dataclass(frozen=True, slots=True)
class SendSticks:
    """Hand one stick frame to the line.

    Attributes:
        counts: limited sticks [stick; FLU].
        deadline: not sent after this [s; monotonic].
        epoch: lease it stands on.
        sequence: number of the setpoint it came from.
        age: age of that setpoint [s].
        is_limited: the limiter changed what was asked for, in whole counts.
        wanted: the sticks that the flight asked for [stick; FLU]; None if unknown.
    """

    counts: StickCounts
    deadline: float
    epoch: int
    sequence: int
    age: float
    is_limited: bool
    wanted: Sticks | None = None


@dataclass(frozen=True, slots=True)
class ReleaseAircraft:
    """Release the aircraft, and report `released` to the core afterwards."""

    reason: str


class PublishStatus(StatusValue):
    """Publish `control/status`."""


@dataclass(frozen=True, slots=True)
class PublishEstimate:
    """Publish `control/estimate`."""

    value: EstimateValue


@dataclass(frozen=True, slots=True)
class PublishError:
    """Publish `control/error`."""

    value: ErrorValue


@dataclass(frozen=True, slots=True)
class PublishPath:
    """Publish `control/path`."""

    value: PathProgress


@dataclass(frozen=True, slots=True)
class PublishNavi:
    """Publish `control/navi`."""

    value: NaviFlight


@dataclass(frozen=True, slots=True)
class ReportMode:
    """Authority moved from one phase to another."""

    before: Phase
    after: Phase
    reason: str


@dataclass(frozen=True, slots=True)
class ReportFailsafe:
    """The ladder took a step on its own; `released` says whether a release was confirmed, None where it cannot be."""

    action: str
    reason: str
    released: bool | None = None


@dataclass(frozen=True, slots=True)
class ReportCommand:
    """A setpoint was refused, or was the first of its epoch."""

    key: str
    fields: dict[str, Any]
    result: CommandResult


@dataclass(frozen=True, slots=True)
class Warn:
    """Something worth a line in the log."""

    text: str


Report = ReportMode | ReportFailsafe | ReportCommand | Warn
"""What goes into the audit trail."""
Action = (
    SendSticks | ReleaseAircraft | PublishEstimate | PublishError | PublishPath | PublishNavi | PublishStatus | Report
)

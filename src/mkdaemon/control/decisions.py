"""What authority decides at a tick."""

from __future__ import annotations

from dataclasses import dataclass

from mkdaemon.control.limiter import Sticks


@dataclass(frozen=True, slots=True)
class SendNothing:
    """Send nothing."""


@dataclass(frozen=True, slots=True)
class Fly:
    """Send these sticks, through the limiter, which levels them when they are too old.

    Attributes:
        sticks: what the holder of the lease asked for [stick; FLU].
        age: time since it arrived [s].
        ttl: time it claims to hold [s].
        epoch: the lease.
        sequence: the setpoint's number.
    """

    sticks: Sticks
    age: float
    ttl: float
    epoch: int
    sequence: int


@dataclass(frozen=True, slots=True)
class ReleaseOrder:
    """Release the aircraft now, and call `released` when that is done.

    Attributes:
        reason: why, one sentence.
        holder: who lost the lease; empty for nobody.
        asked: somebody asked for it, so it is no failsafe.
    """

    reason: str
    holder: str
    asked: bool


Decision = SendNothing | Fly | ReleaseOrder

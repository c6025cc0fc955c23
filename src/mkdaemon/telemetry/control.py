"""Who flies, and what is sent because of it."""

from __future__ import annotations

from enum import StrEnum

from mkdaemon.telemetry.base import Stamped, Telemetry


class Phase(StrEnum):
    """Where authority stands; the ladder of docs/safety.md."""

    FREE = "free"
    """Nobody holds the lease; nothing is sent."""
    LEASED = "leased"
    """Someone holds it; nothing is sent until a live, neutral stream has been seen."""
    FLYING = "flying"
    """Stick frames are sent."""
    STALE = "stale"
    """The setpoint is too old: neutral sticks at hover throttle are sent."""
    RELEASING = "releasing"
    """The aircraft is being let go of; nobody's setpoints are sent."""


class LeaseState(Telemetry):
    """The lease, as answered by `do/lease` and shown in `control/status`."""

    holder: str
    """Who may fly."""
    epoch: int
    """Every lease has its own; setpoints of any other are refused."""
    ttl: float
    """Life without renewal or setpoints [s]."""
    left: float
    """Time until it ends without a sign of life [s]."""


class ControlStatus(Stamped):
    """Authority and what it does: `control/status`, on every change and once a second."""

    phase: Phase
    """Where authority stands."""
    reason: str
    """Why it stands there, one sentence."""
    lease: LeaseState | None
    """Who may fly; null for nobody."""
    setpoint_age: float | None
    """Age of the setpoint in use [s]."""
    refused: int
    """Setpoints refused since the start."""
    external_control: str | None
    """Layout of stick frames this aircraft takes; null where control is not possible."""


class ControlOutput(Stamped):
    """One stick frame at the moment it was handed to the line: `control/output`. FLU signs, after the limiter."""

    epoch: int
    """The lease it stands on."""
    sequence: int
    """The setpoint it came from."""
    age: float
    """Age of that setpoint [s]."""
    pitch: int
    """Nose down positive [stick]."""
    roll: int
    """Right side down positive [stick]."""
    yaw: int
    """Nose left positive [stick]."""
    throttle: int
    """More lift positive [stick from the centre]."""
    limited: bool
    """Whether the limiter changed what was asked for."""

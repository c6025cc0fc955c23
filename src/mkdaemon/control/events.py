"""The events of the flight core, one frozen class each, and its answers. Pure.

An event says what happened, never what follows from it. `FlightCore.feed(event, now)` is the only way in; `now` is when
it happened [s; monotonic]: when a setpoint or a frame arrived, when a request was made. A recording of the events is
all that a replay needs. To add an event, add its class here and its row in `FlightCore`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.control.activeset import KnownSet
from mkdaemon.control.estimator.model import AircraftModel, ModelUnknown
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, LeaseState, ReleaseOutcome
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.path import PathUploadRequest
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.vision import PoseRefused, VisionPose, VisionStats


@dataclass(frozen=True, slots=True)
class Event:
    """An event of the flight core."""


# -- what clients want --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SetpointAccepted(Event):
    """A streamed setpoint whose signature was verified at the door of the bus.

    Attributes:
        setpoint: what is asked for.
        signed_for: epoch of the lease whose secret signed it. The lease may have changed hands since.
    """

    setpoint: Setpoint
    signed_for: int


@dataclass(frozen=True, slots=True)
class SetpointUnsigned(Event):
    """A streamed setpoint that the holder of the lease did not sign."""

    setpoint: Setpoint


@dataclass(frozen=True, slots=True)
class SetpointUnreadable(Event):
    """Something arrived on the key of a setpoint and is none.

    Attributes:
        key: where it came, without `mk/<vehicle>/`.
        fields: what could be read of it.
        error: what is wrong with it.
        is_by_holder: the holder of the lease signed it.
    """

    key: str
    fields: Mapping[str, Any]
    error: CommandRejectedError
    is_by_holder: bool


@dataclass(frozen=True, slots=True)
class LeaseAsked(Event):
    """A client asks about the lease.

    Attributes:
        request: what it asks for.
        secret: for the holder of a new lease only: an unguessable number, drawn by the caller of `feed`.
        found: what was read after the same request was answered with `must_read_set`; None before.
    """

    request: LeaseRequest
    secret: str
    found: KnownSet | None = None


@dataclass(frozen=True, slots=True)
class ReleaseAsked(Event):
    """A client asks to end the lease and to release the aircraft."""

    request: ReleaseRequest


@dataclass(frozen=True, slots=True)
class AbortAsked(Event):
    """A client asks to stop the manoeuvre; the lease continues."""

    request: AbortRequest


@dataclass(frozen=True, slots=True)
class PathUploaded(Event):
    """A client uploads a path."""

    request: PathUploadRequest


@dataclass(frozen=True, slots=True)
class ClientGone(Event):
    """A client lost its liveliness token."""

    name: str


# -- what the boards and the cameras report -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class StateValue(Event):
    """A state value from the boards."""

    value: Telemetry


@dataclass(frozen=True, slots=True)
class MotorsReported(Event):
    """The motors' state from a message."""

    are_running: bool


@dataclass(frozen=True, slots=True)
class FlightctrlReported(Event):
    """Whether the NaviCtrl hears its FlightCtrl."""

    is_lost: bool


@dataclass(frozen=True, slots=True)
class MotorTestSent(Event):
    """Motors are about to turn because a client tests them."""


@dataclass(frozen=True, slots=True)
class ListChanged(Event):
    """The daemon changed the NaviCtrl's list of points."""


@dataclass(frozen=True, slots=True)
class PoseSeen(Event):
    """A camera saw a target."""

    pose: VisionPose


@dataclass(frozen=True, slots=True)
class SightRefused(Event):
    """A camera saw a target and its eyes refused the pose."""

    refused: PoseRefused


@dataclass(frozen=True, slots=True)
class EyeStats(Event):
    """State of a camera."""

    stats: VisionStats


@dataclass(frozen=True, slots=True)
class FreeDisk(Event):
    """Free space where flights are recorded.

    Attributes:
        free: [bytes]; None if unknown.
    """

    free: float | None


@dataclass(frozen=True, slots=True)
class CellsKnown(Event):
    """Number of the battery's cells, configured or remembered."""

    cells: int


@dataclass(frozen=True, slots=True)
class ModelKnown(Event):
    """The model to fly by.

    Attributes:
        model: of the aircraft.
        unknown: why it is not that of the aircraft's own parameter set; None where it is.
    """

    model: AircraftModel
    unknown: ModelUnknown | None = None


@dataclass(frozen=True, slots=True)
class ActiveSetRead(Event):
    """The active parameter set of the FlightCtrl was read."""

    found: KnownSet


# -- what the line reports ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LineChanged(Event):
    """The link accepts something else than before."""

    line: ControlLine


@dataclass(frozen=True, slots=True)
class LinkVerdict(Event):
    """A verdict on the line."""

    state: LinkState


@dataclass(frozen=True, slots=True)
class LinkMeasured(Event):
    """Measurements of the line."""

    health: LinkHealth


@dataclass(frozen=True, slots=True)
class FrameSent(Event):
    """A stick frame was written to the port.

    Attributes:
        number: under which its confirmation comes; the same again after 255 frames.
    """

    number: int


@dataclass(frozen=True, slots=True)
class FrameConfirmed(Event):
    """The board confirmed an external control frame."""

    number: int


@dataclass(frozen=True, slots=True)
class FrameNotSent(Event):
    """The line refused a stick frame that the core wanted sent."""

    error: CommandRejectedError


@dataclass(frozen=True, slots=True)
class GuardChanged(Event):
    """Whether the guard is there."""

    is_alive: bool


@dataclass(frozen=True, slots=True)
class GuardActed(Event):
    """The guard released the aircraft in the daemon's place."""


@dataclass(frozen=True, slots=True)
class Released(Event):
    """A release has ended.

    Attributes:
        outcome: how; None where it did not end in time.
    """

    outcome: ReleaseOutcome | None


@dataclass(frozen=True, slots=True)
class Reply:
    """Answer of the flight core to an event.

    Attributes:
        refusal: why what was asked for was refused; None where it was not.
        lease: the lease now; a `LeaseGrant` for the client that took it; None without a lease.
        must_read_set: the active set must be read first: ask again with what was found.
        is_due: a tick is due at once.
    """

    refusal: CommandRejectedError | None = None
    lease: LeaseState | None = None
    must_read_set: bool = False
    is_due: bool = False


NOTED: Final = Reply()
"""It was taken note of."""
DUE: Final = Reply(is_due=True)
"""It was taken note of, and the next tick must judge it."""
Feed = Callable[[Event, float], Reply]
"""Tells the flight core of an event at a time [s; monotonic]."""

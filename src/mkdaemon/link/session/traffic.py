"""Traffic of the line with time stamps: the values that the link passes to its listeners."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple, NewType, Protocol

from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.decoder import Layouts, Unknown
from mkdaemon.protocol.framing import DropReason, Frame
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.control import ReleaseOutcome
from mkdaemon.telemetry.link import LinkHealth, LinkState, LinkTraffic


class Purpose(IntEnum):
    """Purpose of a sent frame; a smaller number goes first."""

    RELEASE = 0
    """Releases the aircraft."""
    SETPOINT = 1
    """External control, newest wins."""
    RETRY = 2
    """A request that was not answered."""
    REQUEST = 3
    """A task waits for the reply."""
    SUBSCRIPTION = 4
    """Starts, renews or stops a stream."""
    ECHO = 5
    """Tests the link."""
    BACKGROUND = 6
    """Labels, settings: whenever there is room."""


FrameNumber = NewType("FrameNumber", int)
"""Number of an external control frame, 1..255: the board's confirmation repeats it. Never 0, which asks for none."""
UNNUMBERED: Final = FrameNumber(0)
"""Asks for no confirmation."""
BuildControl = Callable[[FrameNumber], WireMessage]
"""Makes the external control message that carries a frame number."""
BuildSetpoint = Callable[[type[WireMessage], FrameNumber], WireMessage]
"""Makes the same in the layout of this aircraft."""


@dataclass(frozen=True, slots=True)
class SetpointQueued:
    """A setpoint that the line took; it leaves at its turn unless a newer one or its deadline comes first.

    Attributes:
        number: of its frame.
    """

    number: FrameNumber


@dataclass(frozen=True, slots=True)
class SetpointRefused:
    """A setpoint that the line did not take: nothing of it is sent.

    Attributes:
        refusal: why.
    """

    refusal: CommandRejectedError


SetpointFate = SetpointQueued | SetpointRefused
"""What became of a setpoint that was handed in: a line that takes none is nothing unusual, so nothing is raised."""


class Received(NamedTuple):
    """One right frame from a board.

    Attributes:
        at: when its last byte was read [s; monotonic].
        frame: as it stood on the wire.
        message: typed, or `Unknown` with the reason.
    """

    at: float
    frame: Frame
    message: WireMessage | Unknown


class Sent(NamedTuple):
    """One transmission, handed to the port.

    Attributes:
        at: when [s; monotonic].
        raw: every byte written, a resynchronising `CR CR` included.
        message: what it says; None for bytes that are not a frame (the escape sequence).
        purpose: why it was sent.
    """

    at: float
    raw: bytes
    message: WireMessage | None
    purpose: Purpose


class Lost(NamedTuple):
    """Something that did not get through.

    Attributes:
        at: when it was noticed [s; monotonic].
        direction: from the board for bytes that did not become a frame, to it for a frame never sent.
        reason: why.
        raw: the bytes.
    """

    at: float
    direction: Direction
    reason: DropReason
    raw: bytes


class LinkSink(Protocol):
    """Receives events of the line; called from the reading task, so every method must return at once."""

    def received(self, frame: Received) -> None:
        """Take a right frame."""

    def sent(self, frame: Sent) -> None:
        """Take a transmission."""

    def dropped(self, loss: Lost) -> None:
        """Take a loss."""

    def state_changed(self, state: LinkState) -> None:
        """Take a new state, at once when the condition changes."""

    def health_measured(self, health: LinkHealth) -> None:
        """Take the measurements, five times a second and with every change of the condition."""

    def stream_ended(self, key: str) -> None:
        """Take note that a stream which another program left behind is ended."""

    def traffic_counted(self, traffic: LinkTraffic) -> None:
        """Take the counters, once a second."""


class LineTap(Protocol):
    """Records the port's events and the link's decisions; every method returns at once."""

    def port_opened(self, port: str, baud: int, at: float) -> None:
        """Take note of an open port."""

    def port_read(self, data: bytes, at: float) -> None:
        """Take bytes, in the portions in which they are decoded."""

    def port_written(self, data: bytes, at: float, issuer: str) -> None:
        """Take bytes that were given to the port, and what for."""

    def port_lost(self, reason: str, at: float) -> None:
        """Take note of the port's end; decoding ends with it."""

    def layouts_changed(self, layouts: Layouts, at: float) -> None:
        """Take the layouts by which frames are decoded from now on."""


@dataclass(frozen=True, slots=True)
class ReleaseResult:
    """Outcome of a release.

    Attributes:
        status: `confirmed` (five `B` seen), `not_observable` (sent, no `B` can come here), `unconfirmed` (a `B` could
            have come and did not; polling that keeps the sticks alive is silenced), `not_sent` (no open port: the
            release is the first thing sent after opening).
        sent: frames with Config = 0 sent.
        confirmed: of those, confirmed by the board.
        reason: why it was released.
    """

    status: ReleaseOutcome
    sent: int
    confirmed: int
    reason: str

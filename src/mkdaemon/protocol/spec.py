"""The table's entry for one message and layout."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.boards import Board, Direction
from mkdaemon.protocol.fields import WireField
from mkdaemon.protocol.framing import FRAME_OVERHEAD, padded_length
from mkdaemon.protocol.layout import Slot
from mkdaemon.protocol.sources import Source
from mkdaemon.telemetry.danger import Danger


@dataclass(frozen=True, slots=True)
class Policy:
    """Time-out and attempts of a request.

    Attributes:
        timeout: wait for the first answer [s]; every retry waits 1.5 times longer than the one before.
        retries: further attempts.
        deaf: how long the board does not listen after the command [s].

    Source: docs/firmware-notes.md, "Timing".
    """

    timeout: float = 0.3
    retries: int = 3
    deaf: float = 0.0


DEFAULT_POLICY: Final = Policy()
"""How a request is asked that declares nothing else."""


@dataclass(frozen=True, slots=True)
class StreamSpec:
    """A stream that a request with an interval starts.

    Attributes:
        key: the message that is streamed, as in keys.
        renews: order in which an unwanted stream is requested with interval 0, to renew the others
            without costing a frame; None for a stream that is answered even then.
        is_vital: a flight by setpoints or images needs it.
    """

    key: str
    renews: int | None = None
    is_vital: bool = False


@dataclass(frozen=True, slots=True)
class MessageSpec:
    """Everything the table knows about one message and layout.

    Attributes:
        name: the message, the same for all its layouts, for example `OsdData`.
        key: the message in Zenoh keys, for example `osd`.
        boards: that answer with it, or are asked with it.
        id: command letter.
        layout: which generation of the structure this is.
        direction: host to board or board to host.
        size: bytes of the structure.
        slots: fields in wire order.
        reply: command letter of the answer; None where none comes.
        sources: where the facts come from.
        firmware: which firmware releases speak this layout.
        marker: values of the first byte that tell this layout from others of the same length; empty for any.
        recognise: whether a payload of the right length is this layout, where its contents tell; None for any.
        any_address: boards also act on it when it is addressed to another board or to none.
        open_ended: longer payloads are this message too (newer firmware appends fields).
        policies: how each board is asked, where that is not `DEFAULT_POLICY`.
        matches: whether an answer with the right letter answers this very request; None: every one does.
        danger: what harm it can do and what it must meet; None where it is harmless.
        stream: what it starts; None where it starts nothing.
        is_forwarded: a NaviCtrl passes it on to the FlightCtrl.
        since: first release (major, minor) of each board that knows it; a board that is absent always did.
        is_fork: only a public fork of the FlightCtrl knows it.
        tells_firmware: it tells something about the firmware that sent it.
    """

    name: str
    key: str
    boards: tuple[Board, ...]
    id: str
    layout: str
    direction: Direction
    size: int
    slots: tuple[Slot, ...]
    reply: str | None = None
    sources: tuple[Source, ...] = ()
    firmware: str = ""
    marker: frozenset[int] = frozenset()
    recognise: Callable[[bytes], bool] | None = None
    any_address: bool = False
    open_ended: bool = False
    policies: Mapping[Board, Policy] = field(default_factory=dict)
    matches: Callable[[Any, Any], bool] | None = None
    danger: Danger | None = None
    stream: StreamSpec | None = None
    is_forwarded: bool = False
    since: Mapping[Board, tuple[int, int]] = field(default_factory=dict)
    is_fork: bool = False
    tells_firmware: bool = False
    packer: struct.Struct = field(default_factory=lambda: struct.Struct("<"), repr=False)

    def fits(self, payload: bytes) -> bool:
        """Whether a received payload can be this layout (it arrives padded to a multiple of three)."""
        return self.has_length(len(payload)) and (self.test is None or self.test(payload))

    def has_length(self, length: int) -> bool:
        """Whether a received payload of this length can be this layout."""
        shortest = padded_length(self.size)
        return length == shortest or (length > shortest and (self.open_ended or length <= self.longest))

    @property
    def characters(self) -> int:
        """Length of its frame on the wire, from `#` to CR; the least where the message has a variable length."""
        return FRAME_OVERHEAD + padded_length(self.size) // 3 * 4

    def policy(self, board: Board) -> Policy:
        """Return how this board is asked."""
        return self.policies.get(board, DEFAULT_POLICY)

    @property
    def longest(self) -> int:
        """Longest received payload of a message of variable length; 0 for a fixed structure."""
        last = self.slots[-1].wire if self.slots else None
        return padded_length(self.size - last.count + last.longest) if last is not None and last.longest else 0

    def wire(self, name: str) -> WireField:
        """Return how a field stands on the wire.

        Raises:
            ProtocolError: the message has no such field.
        """
        for slot in self.slots:
            if slot.name == name:
                return slot.wire
        msg = f"{self.name} ({self.layout}) has no field {name!r}; it has {', '.join(s.name for s in self.slots)}"
        raise ProtocolError(msg)

    @property
    def test(self) -> Callable[[bytes], bool] | None:
        """Recognises this layout by the content of a payload of the right length; None: the length suffices."""
        marker = self.marker
        return (lambda payload: payload[0] in marker) if marker else self.recognise

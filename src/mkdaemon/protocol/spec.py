"""What the table knows about one message and layout."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.boards import Board, Direction
from mkdaemon.protocol.fields import WireField
from mkdaemon.protocol.framing import padded_length
from mkdaemon.protocol.layout import Slot


@dataclass(frozen=True, slots=True)
class MessageSpec:
    """Everything the table knows about one message and layout.

    Attributes:
        name: the message, the same for all its layouts, for example `OsdData`.
        key: the message in Zenoh keys, for example `osd`.
        boards: whose it is: who answers with it, or who is asked with it.
        id: command letter.
        layout: which generation of the structure this is.
        direction: host to board or board to host.
        size: bytes of the structure.
        slots: fields in wire order.
        reply: command letter of the answer; None where none comes.
        source: where the facts come from.
        firmware: which firmware releases speak this layout.
        marker: values of the first byte that tell this layout from others of the same length; empty for any.
        recognise: whether a payload of the right length is this layout, where its contents tell; None for any.
        any_address: boards also act on it when it is addressed to another board or to nobody.
        open_ended: longer payloads are this message too (newer firmware appends fields).
        danger: what harm it can do; empty where none.
        since: first release (major, minor) of each board that knows it; a board that is absent always did.
        is_fork: only a public fork of the FlightCtrl knows it.
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
    source: str = ""
    firmware: str = ""
    marker: frozenset[int] = frozenset()
    recognise: Callable[[bytes], bool] | None = None
    any_address: bool = False
    open_ended: bool = False
    danger: str = ""
    since: Mapping[Board, tuple[int, int]] = field(default_factory=dict)
    is_fork: bool = False
    packer: struct.Struct = field(default_factory=lambda: struct.Struct("<"), repr=False)

    def fits(self, payload: bytes) -> bool:
        """Whether a received payload can be this layout (it arrives padded to a multiple of three)."""
        return self.has_length(len(payload)) and (self.test is None or self.test(payload))

    def has_length(self, length: int) -> bool:
        """Whether a received payload of this length can be this layout."""
        shortest = padded_length(self.size)
        return length == shortest or (length > shortest and (self.open_ended or length <= self.longest))

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
        """How to tell from the contents of a payload of the right length whether it is this layout; None: it is."""
        marker = self.marker
        return (lambda payload: payload[0] in marker) if marker else self.recognise

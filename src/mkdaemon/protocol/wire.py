"""The declarative message class and the one table of all messages.

A message is declared once, as a frozen pydantic model whose fields carry `WireField`s; the table is keyed by
``(board, id, layout)`` because letters repeat between boards and structures between firmware generations.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, ClassVar, Final, Self, TypedDict, TypeVar, Unpack

from pydantic import BaseModel, ConfigDict

from mkdaemon.errors import EncodeError, ProtocolError
from mkdaemon.protocol.fields import WireField
from mkdaemon.protocol.framing import Frame, encode_frame, padded_length
from mkdaemon.protocol.layout import Slot, lay_out, make_reader


class Board(IntEnum):
    """Addresses on the line."""

    ANY = 0
    FC = 1
    NC = 2
    MAG = 3
    OSD = 4
    BL = 5

    @property
    def word(self) -> str:
        """Lower-case name used in keys and files."""
        return self.name.lower()


_REDUNDANT: Final = range(11, 27)


def board_at(address: int) -> Board | None:
    """Return whose an address is; 11..26 are the motor controllers on a redundant FlightCtrl's link."""
    if 0 <= address <= Board.BL:
        return Board(address)
    return Board.BL if address in _REDUNDANT else None


class Direction(IntEnum):
    """Which way a message travels, seen from the host."""

    TO_BOARD = 0
    FROM_BOARD = 1


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


class WireMessage(BaseModel):
    """Base of all messages: integers exactly as they stand on the wire, named in English.

    Values become SI only in `translate`, with the scales declared on the fields. Construction validates ranges and
    refuses floats, so nothing out of range can be encoded.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", use_attribute_docstrings=True, ser_json_bytes="hex", val_json_bytes="hex"
    )
    spec: ClassVar[MessageSpec]
    _read: ClassVar[Callable[[bytes], Any]]

    @classmethod
    def decode(cls, payload: bytes) -> Self:
        """Read a payload (padded or not).

        Raises:
            ProtocolError: the payload is shorter than the structure.
        """
        spec = cls.spec
        if len(payload) < spec.size:
            msg = f"{spec.name} ({spec.layout}) needs {spec.size} bytes, got {len(payload)}"
            raise ProtocolError(msg)
        message: Self = cls._read(payload)
        return message

    def encode(self) -> bytes:
        """Return the structure, without padding.

        Raises:
            EncodeError: a value does not fit (possible only for an instance made without validation).
        """
        values: list[Any] = []
        try:
            for name, _, wire in self.spec.slots:
                value = wire.write(getattr(self, name))
                if wire.is_array:
                    values.extend(value)
                else:
                    values.append(value)
            if self.spec.longest:
                rest: bytes = values[-1]
                return self.spec.packer.pack(*values)[: self.spec.slots[-1].offset] + rest
            return self.spec.packer.pack(*values)
        except (struct.error, TypeError, ValueError) as error:
            msg = f"{self.spec.name} ({self.spec.layout}): {error}"
            raise EncodeError(msg) from error

    def si(self, name: str) -> float:
        """Return a field as SI value in FLU axes (see `WireField.to_si`).

        Raises:
            ProtocolError: there is no such field.
        """
        return self.spec.wire(name).to_si(getattr(self, name))

    def to_frame(self, address: Board | None = None) -> bytes:
        """Return the message as a frame, addressed to its own board unless told otherwise.

        Raises:
            EncodeError: see `encode`.
        """
        board = self.spec.boards[0] if address is None else address
        return encode_frame(int(board), self.spec.id, self.encode())


_Message = TypeVar("_Message", bound=type[WireMessage])

MESSAGES: Final[dict[tuple[Board, str, str], type[WireMessage]]] = {}
"""Every message and layout by (board, id, layout); a message of several boards stands once for each."""


class Facts(TypedDict, total=False):
    """What may be said of any message; see `MessageSpec`.

    `name` and `key` follow from the class name where they are left out; `since` as one release holds for all boards.
    """

    name: str
    key: str
    layout: str
    firmware: str
    source: str
    marker: frozenset[int]
    recognise: Callable[[bytes], bool]
    open_ended: bool
    since: tuple[int, int] | Mapping[Board, tuple[int, int]]


def request(
    boards: Board | tuple[Board, ...],
    command: str,
    *,
    reply: str | None = None,
    danger: str = "",
    any_address: bool = False,
    is_fork: bool = False,
    **facts: Unpack[Facts],
) -> Callable[[_Message], _Message]:
    """Enter a message from the host to a board into the table.

    Raises:
        ProtocolError: a field has no wire type, or the place in the table is taken.
    """

    def enter(cls: _Message) -> _Message:
        spec = _specify(cls, Direction.TO_BOARD, boards, command, facts)
        return _enter(cls, replace(spec, reply=reply, danger=danger, any_address=any_address, is_fork=is_fork))

    return enter


def answer(boards: Board | tuple[Board, ...], command: str, **facts: Unpack[Facts]) -> Callable[[_Message], _Message]:
    """Enter a message from a board to the host into the table.

    Raises:
        ProtocolError: a field has no wire type, or the place in the table is taken.
    """

    def enter(cls: _Message) -> _Message:
        return _enter(cls, _specify(cls, Direction.FROM_BOARD, boards, command, facts))

    return enter


def _specify(
    cls: _Message, direction: Direction, boards: Board | tuple[Board, ...], command: str, facts: Facts
) -> MessageSpec:
    slots, packer = lay_out(cls)
    owners = boards if isinstance(boards, tuple) else (boards,)
    name = facts.get("name", cls.__name__)
    since = facts.get("since", {})
    return MessageSpec(
        name=name,
        key=facts.get("key", re.sub("(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()),
        boards=owners,
        id=command,
        layout=facts.get("layout", "1"),
        direction=direction,
        size=packer.size,
        slots=slots,
        firmware=facts.get("firmware", ""),
        source=facts.get("source", ""),
        marker=facts.get("marker", frozenset()),
        recognise=facts.get("recognise"),
        open_ended=facts.get("open_ended", False),
        since=dict.fromkeys(owners, since) if isinstance(since, tuple) else since,
        packer=packer,
    )


def _enter(cls: _Message, spec: MessageSpec) -> _Message:
    cls.spec = spec
    cls._read = make_reader(cls, spec.slots, spec.packer)
    for board in spec.boards:
        place = (board, spec.id, spec.layout)
        if place in MESSAGES:
            msg = f"{cls.__name__} and {MESSAGES[place].__name__} both claim {place}"
            raise ProtocolError(msg)
        MESSAGES[place] = cls
    return cls


@dataclass(frozen=True, slots=True)
class Unknown:
    """A frame with a right checksum that no message in the table fits.

    Attributes:
        board: who sent it or was addressed; None for an address outside the table.
        id: command letter.
        payload: decoded bytes.
        reason: one sentence: no such command, or a length no layout has.
    """

    board: Board | None
    id: str
    payload: bytes
    reason: str


Layouts = Mapping[tuple[Board, str], str]
"""Which layout a board speaks for a command letter, where the dialect has decided it."""


_Choice = tuple[Callable[[bytes], bool] | None, Callable[[bytes], WireMessage]]


def _choice(cls: type[WireMessage]) -> _Choice:
    return cls.spec.test, cls._read


class MessageDecoder:
    """Gives each frame its type; a dialect decides between layouts that look the same."""

    def __init__(self, layouts: Layouts | None = None) -> None:
        self._layouts = dict(layouts or {})
        self._choices: dict[tuple[int, str, int], tuple[_Choice, ...]] = {}

    def decode(self, frame: Frame) -> WireMessage | Unknown:
        """Return the typed message, or `Unknown` with the reason; never raises."""
        address, letter, payload, _ = frame
        place = (address, letter, len(payload))
        choices = self._choices.get(place)
        if choices is None:
            choices = self._choices[place] = tuple(map(_choice, self._find(frame)))
        for test, read in choices:
            if test is None or test(payload):
                return read(payload)
        return self._unknown(frame)

    def _find(self, frame: Frame) -> tuple[type[WireMessage], ...]:
        """All layouts of this letter and length, the dialect's first."""
        asked = board_at(frame.address)
        preferred = {layout for place, layout in self._layouts.items() if place == (asked, frame.id)}
        found: list[type[WireMessage]] = []
        for (board, letter, layout), cls in MESSAGES.items():
            if (
                letter != frame.id
                or cls in found
                or not (board == asked or (asked == Board.ANY and cls.spec.any_address))
            ):
                continue
            if not cls.spec.has_length(len(frame.payload)):
                continue
            found.insert(0 if layout in preferred else len(found), cls)
        return tuple(found)

    @staticmethod
    def _unknown(frame: Frame) -> Unknown:
        board = board_at(frame.address)
        letters = {letter for owner, letter, _ in MESSAGES if board in {owner, Board.ANY}}
        if board is None:
            reason = f"no board has address {frame.address}"
        elif frame.id in letters:
            reason = f"no layout of {frame.id!r} has {len(frame.payload)} bytes like this"
        else:
            reason = f"{board.word} has no command {frame.id!r}"
        return Unknown(board, frame.id, frame.payload, reason)

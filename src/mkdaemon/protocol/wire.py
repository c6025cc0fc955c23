"""The declarative message class and the one table of all messages.

A message is declared once, as a frozen pydantic model whose fields carry `WireField`s; the table is keyed by
``(board, id, layout)`` because letters repeat between boards and structures between firmware generations.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar, Final, Self, TypedDict, TypeVar, Unpack

from pydantic import ConfigDict

from mkdaemon.described import Described
from mkdaemon.errors import EncodeError, ProtocolError
from mkdaemon.protocol.boards import Board, Direction
from mkdaemon.protocol.framing import encode_frame
from mkdaemon.protocol.layout import lay_out, make_reader
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import MessageSpec, Policy, StreamSpec
from mkdaemon.telemetry.danger import Danger

__all__ = ["MESSAGES", "Board", "Direction", "Facts", "MessageSpec", "WireMessage", "answer", "reader_of", "request"]


class WireMessage(Described):
    """Base of all messages: integers exactly as they stand on the wire, named in English.

    Values become SI only in `translate`, with the scales declared on the fields. Construction validates ranges and
    refuses floats, so nothing out of range can be encoded.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        ser_json_bytes="hex",
        val_json_bytes="hex",
        defer_build=True,  # halves the time of the import
    )
    spec: ClassVar[MessageSpec]

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
        message: Self = reader_of(cls)(payload)
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
        """Return the message as a frame, addressed to its own board by default.

        Raises:
            EncodeError: see `encode`.
        """
        board = self.spec.boards[0] if address is None else address
        return encode_frame(int(board), self.spec.id, self.encode())


@cache
def reader_of(cls: type[WireMessage]) -> Callable[[bytes], Any]:
    """Return the function from a payload that is long enough to an instance; written when first used."""
    return make_reader(cls, cls.spec.slots, cls.spec.packer)


_Message = TypeVar("_Message", bound=type[WireMessage])

MESSAGES: Final[dict[tuple[Board, str, str], type[WireMessage]]] = {}
"""Every message and layout by (board, id, layout); a message of several boards stands once for each."""


class Facts(TypedDict, total=False):
    """Optional properties of a message; see `MessageSpec`.

    `name` and `key` follow from the class name where they are left out; `since` as one release holds for all boards.
    """

    name: str
    key: str
    layout: str
    firmware: str
    source: Source | tuple[Source, ...]
    marker: frozenset[int]
    recognise: Callable[[bytes], bool]
    open_ended: bool
    since: tuple[int, int] | Mapping[Board, tuple[int, int]]


def request(
    boards: Board | tuple[Board, ...],
    command: str,
    *,
    reply: str | None = None,
    policy: Policy | Mapping[Board, Policy] | None = None,
    matches: Callable[[Any, Any], bool] | None = None,
    danger: Danger | None = None,
    stream: StreamSpec | None = None,
    any_address: bool = False,
    is_forwarded: bool = False,
    is_fork: bool = False,
    **facts: Unpack[Facts],
) -> Callable[[_Message], _Message]:
    """Enter a message from the host to a board into the table; for the columns see `MessageSpec`.

    Args:
        boards: the addressees.
        command: its letter.
        reply: letter of the answer; None where none comes.
        policy: how boards are asked; one `Policy` holds for all of them.
        matches: whether an answer (second) answers this very request (first).
        danger: what harm it can do.
        stream: what it starts.
        any_address: boards obey it whatever the address.
        is_forwarded: a NaviCtrl passes it on to the FlightCtrl.
        is_fork: only a public fork of the FlightCtrl knows it.
        facts: what may be said of any message.

    Raises:
        ProtocolError: a field has no wire type, or the place in the table is taken.
    """

    def enter(cls: _Message) -> _Message:
        spec = _specify(cls, Direction.TO_BOARD, boards, command, facts)
        policies = dict.fromkeys(spec.boards, policy) if isinstance(policy, Policy) else policy or {}
        return _enter(
            cls,
            replace(
                spec,
                reply=reply,
                policies=policies,
                matches=matches,
                danger=danger,
                stream=stream,
                any_address=any_address,
                is_forwarded=is_forwarded,
                is_fork=is_fork,
            ),
        )

    return enter


def answer(
    boards: Board | tuple[Board, ...], command: str, *, tells_firmware: bool = False, **facts: Unpack[Facts]
) -> Callable[[_Message], _Message]:
    """Enter a message from a board to the host into the table; for the columns see `MessageSpec`.

    Raises:
        ProtocolError: a field has no wire type, or the place in the table is taken.
    """

    def enter(cls: _Message) -> _Message:
        spec = _specify(cls, Direction.FROM_BOARD, boards, command, facts)
        return _enter(cls, replace(spec, tells_firmware=tells_firmware))

    return enter


def _specify(
    cls: _Message, direction: Direction, boards: Board | tuple[Board, ...], command: str, facts: Facts
) -> MessageSpec:
    slots, packer = lay_out(cls)
    owners = boards if isinstance(boards, tuple) else (boards,)
    name = facts.get("name", cls.__name__)
    since = facts.get("since", {})
    source = facts.get("source", ())
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
        sources=source if isinstance(source, tuple) else (source,),
        marker=facts.get("marker", frozenset()),
        recognise=facts.get("recognise"),
        open_ended=facts.get("open_ended", False),
        since=dict.fromkeys(owners, since) if isinstance(since, tuple) else since,
        packer=packer,
    )


def _enter(cls: _Message, spec: MessageSpec) -> _Message:
    cls.spec = spec
    for board in spec.boards:
        place = (board, spec.id, spec.layout)
        if place in MESSAGES:
            msg = f"{cls.__name__} and {MESSAGES[place].__name__} both claim {place}"
            raise ProtocolError(msg)
        MESSAGES[place] = cls
    return cls

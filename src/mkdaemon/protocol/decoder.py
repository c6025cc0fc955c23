"""From frames to typed messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mkdaemon.protocol.boards import Board, board_at
from mkdaemon.protocol.framing import Frame
from mkdaemon.protocol.wire import MESSAGES, WireMessage, reader_of


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
    return cls.spec.test, reader_of(cls)


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

"""Which command is known in which firmware generation, simulated, and seen in a recording of genuine boards."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.protocol import decode_capture
from mkdaemon.protocol.dialect import Dialect, Evidence, decide
from mkdaemon.protocol.generations import Release
from mkdaemon.protocol.messages import NaviVersion200, NaviVersionClassic, VersionClassic, VersionFc200, VersionFc210
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage
from mksim.boards import flightctrl, navictrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS

RECORDED: Final = {Board.FC: Release(2, 12), Board.NC: Release(0, 24)}
"""Releases the recordings in tests/data were made with."""

_SHOWN: Final = {
    Board.FC: ((0, 71), (0, 78), (0, 84), (0, 90), (2, 0), (2, 8), (2, 12), (2, 14), (2, 22)),
    Board.NC: ((0, 20), (0, 24), (0, 28), (2, 4), (2, 14)),
}
"""One release of each generation that differs from its neighbours."""

_SIMULATED: Final = {
    Board.FC: ({generation.release[:2] for generation in FC_GENERATIONS.values()}, flightctrl.HANDLED),
    Board.NC: ({generation.release[:2] for generation in NC_GENERATIONS.values()}, navictrl.HANDLED),
}

_Place = tuple[Board, str, str]


class Row(NamedTuple):
    """One message of one board.

    Attributes:
        letter: command letter.
        name: message.
        cells: what is known of it, by release, as `coverage` says.
    """

    letter: str
    name: str
    cells: tuple[str, ...]


def shown_releases(board: Board) -> tuple[str, ...]:
    """Return the releases the cells of a board stand for."""
    return tuple(str(Release(*release))[:-1] for release in _SHOWN[board])


def coverage(board: Board, recordings: Path) -> Iterator[Row]:
    """Yield one row a message: in each release its layout, with S where simulated and R where recorded; else a dot.

    Args:
        board: FlightCtrl or NaviCtrl.
        recordings: folder of captures to look for messages in.
    """
    recorded = _recorded(recordings)
    dialects = [_dialect(board, Release(*release)) for release in _SHOWN[board]]
    groups: dict[tuple[str, str], list[type[WireMessage]]] = {}
    for (owner, letter, _), cls in MESSAGES.items():
        if owner is board:
            groups.setdefault((letter, cls.spec.name), []).append(cls)
    for letter, name in sorted(groups, key=lambda group: (group[0].lower(), group)):
        layouts = groups[letter, name]
        cells = tuple(_cell(board, dialect, layouts, recorded) for dialect in dialects)
        yield Row(letter, f"{name} (fork)" if layouts[0].spec.is_fork else name, cells)


def _dialect(board: Board, release: Release) -> Dialect:
    payload = bytes([release.major, release.minor, 11, 0, 0, 0, 0, 0, 0, 0])
    replies = (
        (VersionFc210, VersionFc200, VersionClassic) if board is Board.FC else (NaviVersion200, NaviVersionClassic)
    )
    reply = next(cls for cls in replies if cls.spec.test is None or cls.spec.test(payload))
    return decide(Evidence().with_message(board, reply.decode(payload)))


def _cell(board: Board, dialect: Dialect, layouts: list[type[WireMessage]], recorded: set[_Place]) -> str:
    release = dialect.fc_release if board is Board.FC else dialect.nc_release
    cls = _layout_in(board, dialect, release or Release(0, 0), layouts)
    if cls is None or not _is_known(board, dialect, cls):
        return "·"
    letter = cls.spec.id
    releases, handled = _SIMULATED[board]
    asked = {letter} if cls.spec.direction is Direction.TO_BOARD else _askers(board, letter)
    marks = "S" if release is not None and release[:2] in releases and asked & handled else ""
    if release is not None and release[:2] == RECORDED[board][:2] and (board, letter, cls.spec.layout) in recorded:
        marks += "R"
    return f"{cls.spec.layout} {marks}".strip()


def _layout_in(
    board: Board, dialect: Dialect, release: Release, layouts: list[type[WireMessage]]
) -> type[WireMessage] | None:
    """The dialect's layout, or that the release tells by itself, or the newest the release can have."""
    wanted = dialect.layouts.get((board, layouts[0].spec.id))
    for cls in layouts:
        if cls.spec.layout == wanted:
            return cls
    payload = bytes([*release, *bytes(9)])
    if layouts[0].spec.name == "Version":
        return next((cls for cls in layouts if cls.spec.test is not None and cls.spec.test(payload)), None)
    known = [cls for cls in layouts if cls.spec.since.get(board, (0, 0)) <= release[:2]]
    return max(known, key=lambda cls: cls.spec.since.get(board, (0, 0)), default=None)


def _is_known(board: Board, dialect: Dialect, cls: type[WireMessage]) -> bool:
    """Whether the release has a message: a request that it supports, or the answer to one."""
    if cls.spec.direction is Direction.TO_BOARD:
        # A fork's own commands are known to the fork of every release it was made from.
        return cls.spec.is_fork or (board, cls.spec.key) not in dialect.unsupported
    requests = [
        asking for (owner, _, _), asking in MESSAGES.items() if asking.spec.reply == cls.spec.id and owner is board
    ]
    return not requests or any((board, asking.spec.key) not in dialect.unsupported for asking in requests)


def _askers(board: Board, letter: str) -> set[str]:
    return {asking for (owner, asking, _), cls in MESSAGES.items() if owner is board and cls.spec.reply == letter}


def _recorded(folder: Path) -> set[_Place]:
    """Every layout that stands in one of the recordings, in its own direction."""
    found: set[_Place] = set()
    for path in sorted(folder.glob("*.jsonl")):
        with path.open("rb") as stream:
            for decoded in decode_capture(stream, str(path)):
                board, message = decoded.board, decoded.content
                if isinstance(message, WireMessage) and board and message.spec.direction is decoded.direction:
                    found.add((board, message.spec.id, message.spec.layout))
    return found

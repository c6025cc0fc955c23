"""Names of debug channels, read once a board and firmware and kept: reading them costs 32 questions.

A FlightCtrl from 2.09 on tells a checksum of its labels; the cache is keyed by it. Older boards are keyed by their
release. Source: docs/protocol.md, "Common commands".
"""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mkdaemon.files import write_whole
from mkdaemon.foreignfiles import parse_json, read_text
from mkdaemon.link.procedures import Observer, run_procedure
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.procedures import Patience
from mkdaemon.protocol.procedures.labels import LABELS
from mkdaemon.protocol.procedures.labels import read_labels as labels_procedure
from mkdaemon.protocol.wire import Board

if TYPE_CHECKING:
    from mkdaemon.link.link import Link
    from mkdaemon.protocol.dialect import Dialect

PATIENCE: Final = Patience(attempts=6, timeout=0.5)
"""With each of the 33 questions, in the background of a busy line."""


class LabelCache:
    """Label sets by board and firmware, kept in a file where one is given."""

    def __init__(self, path: Path | None) -> None:
        """Load what is kept; an unreadable file counts as empty, it can be read from the boards again."""
        self._path = path
        self._known: dict[str, list[str]] = {}
        if path is not None:
            with suppress(OSError, ValueError, AttributeError, TypeError):
                kept = parse_json(read_text(path))
                self._known = {str(key): [str(name) for name in names] for key, names in kept.items()}

    def find(self, key: str) -> tuple[str, ...] | None:
        """Return the labels kept under this key."""
        names = self._known.get(key, [])
        return tuple(names) if len(names) == LABELS else None

    def find_for(self, board: Board, dialect: Dialect) -> tuple[str, ...] | None:
        """Return what is kept for the firmware on the line."""
        key = cache_key(board, dialect)
        return None if key is None else self.find(key)

    def keep(self, key: str, labels: tuple[str, ...]) -> None:
        """Keep labels; a file that cannot be written is no reason to fail."""
        self._known[key] = list(labels)
        if self._path is not None:
            with suppress(OSError):
                self._path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(self._path, json.dumps(self._known, indent=1) + "\n", overwrite=True)


def cache_key(board: Board, dialect: Dialect) -> str | None:
    """Under what the labels of a board are kept; None while its firmware is unknown."""
    release = {Board.FC: dialect.fc_release, Board.NC: dialect.nc_release}.get(board)
    if release is None:
        return None
    if board is Board.FC and dialect.label_checksum is not None and release[:2] >= (2, 9):
        return f"{board.word} {release} {dialect.label_checksum:#04x}"
    return f"{board.word} {release}"


async def read_labels(link: Link, board: Board, cache: LabelCache, observer: Observer) -> tuple[str, ...]:
    """Return the 32 labels of a board, from the cache or in the background of everything else on the line.

    Args:
        link: the line.
        board: whose.
        cache: what has been read before.
        observer: hears how far the reading is.

    Raises:
        CommandRejectedError: the board cannot be reached, or `labels_inconsistent`.
        RequestTimeoutError: it did not answer.
        LinkLostError: the port is not open, or was lost meanwhile.
    """
    key = cache_key(board, link.dialect)
    known = cache.find_for(board, link.dialect)
    if known is not None:
        return known
    labels = await run_procedure(link, labels_procedure(board, PATIENCE), observer, purpose=Purpose.BACKGROUND)
    if key is not None:
        cache.keep(key, labels)
    return labels

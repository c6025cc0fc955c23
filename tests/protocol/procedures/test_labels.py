from __future__ import annotations

import pytest

from mkdaemon.errors import CommandRejectedError, RequestTimeoutError
from mkdaemon.protocol.messages import Label, LabelRequest, NaviVersionClassic, VersionFc210, VersionRequest
from mkdaemon.protocol.procedures import Patience
from mkdaemon.protocol.procedures.labels import read_labels
from mkdaemon.protocol.wire import Board, WireMessage

from .talk import Reply, drive

NAMES = tuple(f"Channel {index}" for index in range(32))
CHECKSUM = sum(sum(name.ljust(16).encode()) for name in NAMES) & 0xFF


def fc_version(checksum: int) -> WireMessage:
    return VersionFc210.decode(bytes((2, 12, 11, checksum, 0, 0, 0, 22, 103, 1)))


NC_VERSION = NaviVersionClassic.decode(bytes((0, 24, 11, 0, 1, 0, 0, 0, 0, 0)))


def read_from(board: Board, version: WireMessage, names: tuple[str, ...] = NAMES) -> tuple[str, ...]:
    """Read the labels of a board of some version that tells these names."""

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, VersionRequest):
            return version
        known = isinstance(request, LabelRequest) and request.index < len(names)
        return Label(index=request.index, text=names[request.index]) if known else None

    return drive(read_labels(board, Patience(2)), talk)


@pytest.mark.parametrize(("board", "version"), [(Board.FC, fc_version(CHECKSUM)), (Board.NC, NC_VERSION)])
def test_all_labels_have_the_checksum_where_the_board_tells_one(board: Board, version: WireMessage) -> None:
    assert read_from(board, version) == NAMES


def test_a_wrong_checksum_and_silence_are_named() -> None:
    with pytest.raises(CommandRejectedError, match="labels_inconsistent: the checksum of the labels differs"):
        read_from(Board.FC, fc_version(CHECKSUM ^ 1))
    with pytest.raises(RequestTimeoutError, match="label 0: no answer from the FC in 2 attempts"):
        read_from(Board.FC, fc_version(0), ())

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


def board(checksum: int) -> object:
    def talk(request: WireMessage) -> Reply:
        if isinstance(request, VersionRequest):
            return VersionFc210.decode(bytes((2, 12, 11, checksum, 0, 0, 0, 22, 103, 1)))
        return Label(index=request.index, text=NAMES[request.index]) if isinstance(request, LabelRequest) else None

    return talk


def test_all_labels_have_the_checksum_the_board_tells() -> None:
    assert drive(read_labels(Board.FC, Patience(2)), board(CHECKSUM)) == NAMES  # type: ignore[arg-type]


def test_a_wrong_checksum_is_named() -> None:
    with pytest.raises(CommandRejectedError, match="labels_inconsistent: the checksum of the labels differs"):
        drive(read_labels(Board.FC, Patience(2)), board(CHECKSUM ^ 1))  # type: ignore[arg-type]


def test_a_navictrl_tells_no_checksum() -> None:
    def talk(request: WireMessage) -> Reply:
        if isinstance(request, VersionRequest):
            return NaviVersionClassic.decode(bytes((0, 24, 11, 0, 1, 0, 0, 0, 0, 0)))
        return Label(index=request.index, text=NAMES[request.index]) if isinstance(request, LabelRequest) else None

    assert drive(read_labels(Board.NC, Patience(2)), talk) == NAMES


def test_silence_names_the_label() -> None:
    def talk(request: WireMessage) -> Reply:
        return (
            VersionFc210.decode(bytes((2, 12, 11, 0, 0, 0, 0, 22, 103, 1)))
            if isinstance(request, VersionRequest)
            else None
        )

    with pytest.raises(RequestTimeoutError, match="label 0: no answer from the FC in 2 attempts"):
        drive(read_labels(Board.FC, Patience(2)), talk)

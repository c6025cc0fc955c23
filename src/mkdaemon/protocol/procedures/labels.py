"""Reading the names of a board's debug channels.

A FlightCtrl from 2.09 on tells an 8-bit sum over its label characters, which proves the reading and lets a caller keep
it. Source: docs/protocol.md, "Common commands" and "VersionInfo".
"""

from __future__ import annotations

from typing import get_args

from mkdaemon.protocol.messages import (
    CompassVersion,
    Label,
    LabelRequest,
    NaviVersion200,
    NaviVersionClassic,
    VersionClassic,
    VersionFc200,
    VersionFc210,
    VersionRequest,
)
from mkdaemon.protocol.procedures.steps import Patience, Procedure, Progress, Question, insist
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token, refuse

LABELS = 32
"""Debug channels of every board."""


Version = VersionFc210 | VersionFc200 | VersionClassic | NaviVersion200 | NaviVersionClassic | CompassVersion
"""A version reply of any board and generation."""


def read_version(board: Board, patience: Patience) -> Procedure[Version]:
    """Ask a board for its release; its answer also proves that it is on the line.

    Raises:
        RequestTimeoutError: no answer.
    """
    question: Question[Version] = Question(board, VersionRequest(), get_args(Version), lambda _: True, "version")
    return (yield from insist(question, patience))


def read_labels(board: Board, patience: Patience) -> Procedure[tuple[str, ...]]:
    """Read all 32 labels of a board.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `labels_inconsistent`: they do not have the checksum the board tells.
    """
    version = yield from read_version(board, patience)
    labels: list[Label] = []
    for index in range(LABELS):
        yield Progress(index, LABELS, f"label {index}")
        labels.append((yield from insist(_label(board, index), patience)))
    yield Progress(LABELS, LABELS, "labels")
    if isinstance(version, VersionFc210):
        found = sum(sum(label.encode()[1:]) for label in labels) & 0xFF
        if found != version.label_checksum:
            raise refuse(
                Token.LABELS_INCONSISTENT, board=board.word.upper(), found=found, wanted=version.label_checksum
            )
    return tuple(label.text.strip() for label in labels)


def _label(board: Board, index: int) -> Question[Label]:
    return Question(board, LabelRequest(index=index), (Label,), lambda label: label.index == index, f"label {index}")

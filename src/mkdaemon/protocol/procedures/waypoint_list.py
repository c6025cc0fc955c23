"""Waypoints on a NaviCtrl: clear, upload, verify, download. Stop and wait; only what was read back counts as stored.

The answer to a write is the stored index, and 0 means both "cleared" and "refused". The number of points that the board
then holds shows which; reading an index above every list returns it. That short answer also marks the line: answers
keep their order, so no older answer can follow it.

The checksum has 12 bits, so on a bad line a damaged write now and then gets through, with another index, another
position, or as "clear". Therefore nothing counts as stored before a whole reading of the list, made after the last
write, agrees byte for byte. Sources: docs/protocol.md, "Points"; docs/firmware-notes, "Sending".
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from mkdaemon.protocol.flags import PositionStatus
from mkdaemon.protocol.messages import (
    Waypoint024,
    Waypoint027,
    Waypoint2x,
    WaypointCount,
    WaypointRequest,
    WaypointWritten,
)
from mkdaemon.protocol.procedures.steps import Patience, Procedure, Progress, Question, insist, insist_twice
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.refusals import Token, refuse

_Stored = Waypoint024 | Waypoint027 | Waypoint2x
_COUNT = Question(
    Board.NC, WaypointRequest(index=255), (WaypointCount,), lambda _: True, "number of waypoints"
)  # no list is that long, so the answer is the count alone
_STATUS = 12
"""Byte of a point that the NaviCtrl changes by itself when it flies there."""
_CLEAR_ROUNDS, _ROUNDS, _REFUSALS = 4, 8, 3


@dataclass(frozen=True, slots=True)
class ListDifference:
    """Difference between the board's list and the mission.

    Attributes:
        number: point, counted from 1.
        field: field of the point; empty where the point is absent or one too many.
        wanted: what the mission has.
        stored: what the board has.
    """

    number: int
    field: str
    wanted: object
    stored: object

    def __str__(self) -> str:
        if not self.field:
            return f"point {self.number} is {self.stored}"
        return f"point {self.number}: {self.field} is {self.stored}, not {self.wanted}"


@dataclass(frozen=True, slots=True)
class FinishedUpload:
    """A finished upload: every point was read back and agreed.

    Attributes:
        count: points stored.
        digest: content hash of the list.
        rounds: how often the list was read back.
        writes: points written, repetitions of whole rounds included.
    """

    count: int
    digest: str
    rounds: int
    writes: int


def content_hash(points: Sequence[WireMessage]) -> str:
    """SHA-256 over the points as they are stored, in hexadecimal; the status byte, which boards change, left out."""
    digest = hashlib.sha256()
    for point in points:
        digest.update(_content(point.encode()))
    return digest.hexdigest()


def count_points(patience: Patience) -> Procedure[int]:
    """Ask how many points the NaviCtrl holds, points of interest included.

    Raises:
        RequestTimeoutError: no answer.
    """
    return (yield from insist(_COUNT, patience)).count


def clear_points(kind: type[WireMessage], patience: Patience) -> Procedure[None]:
    """Empty the list and see that it is empty.

    Args:
        kind: class of the board's points.
        patience: how long to insist on each answer.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `not_cleared`.
    """
    count = 0
    for _ in range(_CLEAR_ROUNDS):
        yield from insist(write_point(clear_message(kind), 0), patience)
        count = yield from count_points(patience)
        if count == 0:
            return
    raise refuse(Token.NOT_CLEARED, count=count, rounds=_CLEAR_ROUNDS)


def upload_points(points: Sequence[WireMessage], patience: Patience) -> Procedure[FinishedUpload]:
    """Replace the list by these points and prove it.

    Args:
        points: write messages, numbered from 1 in their order.
        patience: how long to insist on each answer.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `not_cleared`, `point_refused` or `not_verified`.
    """
    total = len(points)
    pending, bad, writes = list(range(total)), list(range(total)), 0
    must_clear = True
    for turn in range(1, _ROUNDS + 1):
        if must_clear:
            yield Progress(0, 2 * total, "clearing")
            yield from clear_points(type(points[0]), patience)
        for done, index in enumerate(pending):
            yield Progress(total - len(pending) + done, 2 * total, f"writing point {index + 1}")
            writes += 1
            if not (yield from _store(points[index], index + 1, total, patience)):
                break
        bad, count = yield from _compare(points, patience)
        if not bad and count == total:
            yield Progress(2 * total, 2 * total, "verified")
            return FinishedUpload(total, content_hash(points), turn, writes)
        must_clear = count > total
        pending = list(range(total)) if must_clear else bad
    where = ", ".join(f"point {index + 1}" for index in bad) or "the end of the list"
    raise refuse(Token.NOT_VERIFIED, rounds=_ROUNDS, where=where)


def verify_points(points: Sequence[WireMessage], patience: Patience) -> Procedure[tuple[ListDifference, ...]]:
    """Compare the list on the board with these points; writes nothing.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `list_changing`.
    """
    stored = yield from download_points(type(points[0]), patience)
    found: list[ListDifference] = []
    for number in range(1, max(len(points), len(stored)) + 1):
        if number > len(stored):
            found.append(ListDifference(number, "", "stored", "absent"))
        elif number > len(points):
            found.append(ListDifference(number, "", "absent", "one too many"))
        else:
            found += _differences(number, points[number - 1], stored[number - 1])
    return tuple(found)


def download_points(kind: type[WireMessage], patience: Patience) -> Procedure[tuple[WireMessage, ...]]:
    """Read the whole list; each point is read until two answers agree.

    Args:
        kind: class of the board's points; the answer has it too.
        patience: how long to insist on each answer.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `list_changing`: the number of points changed meanwhile.
    """
    count = yield from count_points(patience)
    points = []
    for number in range(1, count + 1):
        yield Progress(number - 1, count, f"reading point {number}")
        answer = yield from insist_twice(ask_point(number), patience)
        if isinstance(answer, WaypointCount):
            raise refuse(Token.LIST_CHANGING, before=count, after=answer.count)
        points.append(kind.decode(point_within(answer)))
    after = yield from count_points(patience)
    if after != count:
        raise refuse(Token.LIST_CHANGING, before=count, after=after)
    yield Progress(count, count, "read")
    return tuple(points)


def clear_message(kind: type[WireMessage]) -> WireMessage:
    """Return the write that clears the list: index 0, status invalid, type invalid. Source: vector "list clear"."""
    raw = bytearray(kind.spec.size)
    raw[19] = 255
    return kind.decode(bytes(raw))


def _store(point: WireMessage, number: int, total: int, patience: Patience) -> Procedure[bool]:
    """Write one point; False when the board has lost its list meanwhile and the reading must tell what is left."""
    for _ in range(_REFUSALS):
        if (yield from insist(write_point(point, number), patience)).index == number:
            return True
        # 0: refused, or a late answer to "clear", or the list was cleared by a damaged frame: the state tells.
        count = yield from count_points(patience)
        if count < number - 1:
            return False
    raise refuse(Token.POINT_REFUSED, number=number, total=total, count=count)


def _compare(points: Sequence[WireMessage], patience: Patience) -> Procedure[tuple[list[int], int]]:
    """Read the list once; return the indices that differ or are absent, and how many points the board holds."""
    total = len(points)
    count = yield from count_points(patience)
    bad = []
    for index, point in enumerate(points):
        yield Progress(total + index, 2 * total, f"reading back point {index + 1}")
        if index >= count:
            bad.append(index)
            continue
        answer = yield from insist(ask_point(index + 1), patience)
        if isinstance(answer, WaypointCount) or not is_same_point(point.encode(), point_within(answer)):
            bad.append(index)
    after = yield from count_points(patience)
    return bad, after


def write_point(point: WireMessage, number: int) -> Question[WaypointWritten]:
    """Store one point."""
    return Question(Board.NC, point, (WaypointWritten,), lambda w: w.index in (0, number), f"write waypoint {number}")


def ask_point(number: int) -> Question[_Stored | WaypointCount]:
    """Ask for one point; a shorter list answers with its count, and then the point is absent."""

    def fits(answer: _Stored | WaypointCount) -> bool:
        return answer.count < number if isinstance(answer, WaypointCount) else answer.number == number

    kinds = (*get_args(_Stored), WaypointCount)
    return Question(Board.NC, WaypointRequest(index=number), kinds, fits, f"read waypoint {number}")


def point_within(answer: WireMessage) -> bytes:
    """The 30 bytes of the point within the answer to a reading."""
    return answer.encode()[2:]


def is_same_point(wanted: bytes, stored: bytes) -> bool:
    """Whether a stored point is the wanted one; the board sets its status to processed when it flies there."""
    alive = stored[_STATUS] in (wanted[_STATUS], PositionStatus.PROCESSED)
    return alive and _content(stored) == _content(wanted)


def _content(raw: bytes) -> bytes:
    return raw[:_STATUS] + raw[_STATUS + 1 :]


def _differences(number: int, wanted: WireMessage, stored: WireMessage) -> list[ListDifference]:
    if is_same_point(wanted.encode(), stored.encode()):
        return []
    return [
        ListDifference(number, slot.name, getattr(wanted, slot.name), getattr(stored, slot.name))
        for slot in wanted.spec.slots
        if getattr(wanted, slot.name) != getattr(stored, slot.name)
    ]

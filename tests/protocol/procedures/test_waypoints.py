from __future__ import annotations

from collections.abc import Callable
from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.errors import CommandRejectedError, MkError, RequestTimeoutError
from mkdaemon.protocol.generations import Release
from mkdaemon.protocol.messages import WaypointRequest, WaypointWritten, WriteWaypoint024
from mkdaemon.protocol.procedures import Patience
from mkdaemon.protocol.procedures.points import from_points, point_format, to_points
from mkdaemon.protocol.procedures.steps import Progress, Step
from mkdaemon.protocol.procedures.waypoint_list import (
    clear_message,
    clear_points,
    content_hash,
    download_points,
    upload_points,
    verify_points,
)
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

from .talk import NaviCtrl, Reply, drive, losing

FORM = point_format(Release(0, 24))
PATIENCE = Patience(attempts=4)
Spoil = Callable[[list[bytes]], object]


def route(count: int) -> tuple[WireMessage, ...]:
    points = [
        MissionPoint(latitude_deg=53.07 + n / 1e4, longitude_deg=8.79 - n / 1e4, altitude=10 + n, hold=n % 7)
        for n in range(count)
    ]
    return to_points(Mission(points=tuple(points)), FORM)


def test_upload_of_31_points_is_read_back() -> None:
    board, heard = NaviCtrl(), list[Step]()
    points = route(31)
    done = drive(upload_points(points, PATIENCE), board, heard)
    assert board.points == [point.encode() for point in points]
    assert (done.count, done.rounds, done.writes, done.digest) == (31, 1, 31, content_hash(points))
    progress = [step for step in heard if isinstance(step, Progress)]
    assert progress[-1] == Progress(62, 62, "verified")
    assert [step.done for step in progress] == sorted(step.done for step in progress)


@given(st.data(), st.integers(1, 6))
def test_an_upload_is_right_or_raises_whatever_is_lost(data: st.DataObject, count: int) -> None:
    board, points = NaviCtrl(), route(count)
    fates = data.draw(st.lists(st.sampled_from(["ok", "request", "reply"]), max_size=60))
    try:
        done = drive(upload_points(points, PATIENCE), losing(board, iter(fates)))
    except MkError:
        return
    assert done.count == count
    assert board.points == [point.encode() for point in points]


@given(st.data())
def test_damage_that_passes_the_checksum_is_caught_by_reading_back(data: st.DataObject) -> None:
    """Some writes arrive with another index, other contents, or as "clear"."""
    board, points = NaviCtrl(), route(4)
    fates = iter(data.draw(st.lists(st.sampled_from(["ok", "index", "contents", "status", "clear"]), max_size=30)))

    def talk(request: WireMessage) -> Reply:
        fate = next(fates, "ok")
        if not isinstance(request, WriteWaypoint024) or fate == "ok":
            return board(request)
        if fate == "clear":
            return board(clear_message(WriteWaypoint024))
        raw = bytearray(request.encode())
        raw[{"index": 18, "contents": 3, "status": 12}[fate]] ^= 2
        return board(WriteWaypoint024.decode(bytes(raw)))

    try:
        drive(upload_points(points, PATIENCE), talk)
    except CommandRejectedError as error:
        assert error.token in ("not_verified", "point_refused", "not_cleared")
        return
    except RequestTimeoutError:
        return
    assert board.points == [point.encode() for point in points]


def test_refused_points_are_told_from_a_cleared_list() -> None:
    with pytest.raises(CommandRejectedError, match=r"refused point 4 of 5 \(it answered 0 and still holds 3 points\)"):
        drive(upload_points(route(5), PATIENCE), NaviCtrl(limit=3))


def spoiled(board: NaviCtrl, kind: type[WireMessage], index: int, spoil: Spoil, time: int = 1) -> Callable[..., Reply]:
    """A board whose list is spoiled before it answers a request for some time."""
    asked = count(1)

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, kind) and request.index == index and next(asked) == time:
            spoil(board.points)
        return board(request)

    return talk


@pytest.mark.parametrize(
    ("kind", "index", "spoil"),
    [
        (WriteWaypoint024, 3, list.clear),
        (WaypointRequest, 2, list.clear),
        (WaypointRequest, 1, lambda points: points.append(points[-1])),
    ],
    ids=["cleared while it is written", "cleared while it is compared", "a point too many"],
)
def test_a_list_that_is_spoiled_on_the_way_is_written_again(kind: type[WireMessage], index: int, spoil: Spoil) -> None:
    board, points = NaviCtrl(), route(5)
    done = drive(upload_points(points, PATIENCE), spoiled(board, kind, index, spoil))
    assert board.points == [point.encode() for point in points]
    assert done.rounds in (2, 3)


def test_a_list_that_will_not_clear() -> None:
    board = NaviCtrl()
    board.points = [point.encode() for point in route(2)]

    def talk(request: WireMessage) -> Reply:
        return WaypointWritten(index=0) if isinstance(request, WriteWaypoint024) else board(request)

    with pytest.raises(CommandRejectedError, match="still holds 2 points"):
        drive(clear_points(WriteWaypoint024, PATIENCE), talk)


def test_a_board_that_keeps_something_else_is_named() -> None:
    board = NaviCtrl()

    def talk(request: WireMessage) -> Reply:
        reply = board(request)
        if isinstance(request, WriteWaypoint024) and request.index == 2:
            board.points[1] = board.points[1][:15] + b"\x09" + board.points[1][16:]
        return reply

    with pytest.raises(CommandRejectedError, match=r"not_verified.*at point 2; do not fly"):
        drive(upload_points(route(3), PATIENCE), talk)


def test_verify_names_point_and_field() -> None:
    board, points = NaviCtrl(), route(3)
    drive(upload_points(points, PATIENCE), board)
    assert drive(verify_points(points, PATIENCE), board) == ()
    changed = bytearray(board.points[1])
    changed[16] = 99
    board.points[1] = bytes(changed)
    board.points.pop()
    found = drive(verify_points(points, PATIENCE), board)
    assert [str(difference) for difference in found] == [
        "point 2: hold_time is 99, not 1",
        "point 3 is absent",
    ]
    assert str(drive(verify_points(points[:1], PATIENCE), board)[-1]) == "point 2 is one too many"


@pytest.mark.parametrize(
    ("release", "point", "message"),
    [
        (Release(0, 24), {"speed": 3.0}, "NaviCtrl 0.24a points carry no speed, the mission says 3.0"),
        (Release(0, 30), {"photo_distance": 5}, "points carry no photo_distance"),
        (Release(0, 30), {"kind": PointKind.FAILSAFE}, r"knows no failsafe points \(since 2\.00\)"),
        (Release(2, 14), {"kind": PointKind.LAND}, r"knows no land points \(since 2\.16\)"),
    ],
)
def test_what_a_release_cannot_express_is_refused(release: Release, point: dict[str, object], message: str) -> None:
    mission = Mission(
        points=(MissionPoint.model_validate({"latitude_deg": 1, "longitude_deg": 2, "altitude": 3} | point),)
    )
    with pytest.raises(CommandRejectedError, match=message):
        to_points(mission, point_format(release))


def test_limits_and_units_follow_the_release() -> None:
    mission = Mission(points=(MissionPoint(latitude_deg=1, longitude_deg=2, altitude=3, kind=PointKind.POI),) * 32)
    with pytest.raises(CommandRejectedError, match="32 points and this board holds 31"):
        to_points(mission, FORM)
    assert to_points(mission, point_format(Release(2, 0)))[0].model_dump()["altitude"] == 30
    assert to_points(Mission(points=mission.points[:1]), FORM)[0].model_dump()["altitude"] == 300
    with pytest.raises(CommandRejectedError, match=r"NaviCtrl 9\.00a are not documented"):
        point_format(Release(9, 0))


STORED = route(1)[0].encode()


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (clear_message(WriteWaypoint024), "the board holds an invalid one"),
        (
            WriteWaypoint024.decode(STORED).model_copy(update={"heading": -7}),
            "it looks at point 7, which is not a point of interest",
        ),
        (
            WriteWaypoint024.decode(b"\xff\xff\xff\x7f" * 2 + STORED[8:]),
            r"the board holds one out of range \(latitude 2147483647",
        ),
    ],
)
def test_a_stored_point_that_is_none_is_named(point: WireMessage, words: str) -> None:
    with pytest.raises(CommandRejectedError, match=f"point 1: {words}"):
        from_points([point], FORM)


def test_points_of_later_releases_come_back_whole() -> None:
    form = point_format(Release(2, 16))
    mission = Mission(
        points=(
            MissionPoint(latitude_deg=1, longitude_deg=2, altitude=3, speed=4.5, camera_angle_deg=255, name="P1"),
            MissionPoint(latitude_deg=1, longitude_deg=2, altitude=3, kind=PointKind.LAND, photo_distance=7),
        )
    )
    assert from_points(to_points(mission, form), form) == mission


@pytest.mark.parametrize(("index", "time"), [(2, 1), (255, 2)], ids=["while it is read", "after it was read"])
def test_a_list_that_shrinks_is_named(index: int, time: int) -> None:
    board = NaviCtrl()
    drive(upload_points(route(2), PATIENCE), board)
    with pytest.raises(CommandRejectedError, match=r"changed while it was read \(2 points, then 1\)"):
        drive(download_points(FORM.kind, PATIENCE), spoiled(board, WaypointRequest, index, list.pop, time))

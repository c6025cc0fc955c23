"""The mission protocol against a vehicle that is told what to answer."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.errors import MkError
from mkdaemon.telemetry.mission import MissionEvent, MissionPoint
from mkdaemon.telemetry.navi import NaviStage
from mkdaemon.telemetry.refusals import Token, refuse
from tests.gateways.mavlink import rig
from tests.gateways.mavlink.rig import LAT, LON, NAN, Ears, beat, parts, serving, virtually
from tests.values import STAMP

ACCEPTED, ERROR, FRAME, UNSUPPORTED, NO_SPACE, INVALID = 0, 1, 2, 3, 4, 5
SEQUENCE, DENIED, CANCELLED = 13, 14, 15


def item(seq, command=16, frame=6, params=(2.0, 5.0, 0.0, NAN), x=LAT, y=LON, z=10.0):
    return rig.item(seq, command, frame, params, (x + 100 * seq, y + 50 * seq, z))


SPEED = {"command": 178, "frame": 2, "params": (1.0, 3.0, -1.0, 0.0), "x": 0, "y": 0, "z": 0.0}
LOOK = {"command": 195, "params": (0.0, 0.0, 0.0, 0.0), "z": 0.0}
MISSION = [item(0), item(1, **SPEED), item(2), item(3, **LOOK), item(4, 21, params=(0, 0, 0, NAN), z=0.0), item(5)]


@virtually
async def test_what_was_uploaded_comes_back_bit_for_bit_and_a_program_of_old_gets_items_of_old(vehicle, ears):
    assert await ears.upload(MISSION) == [ACCEPTED]
    name, (points,), options = vehicle.calls[0]
    assert (name, options["in_flight"], options["source"]) == ("upload", True, "MAVLink")
    assert [(point.kind.value, point.speed, point.poi) for point in points] == [
        ("waypoint", 0.0, None), ("waypoint", 3.0, None), ("poi", 0.0, None),
        ("land", 3.0, 3), ("waypoint", 3.0, 3),
    ]  # fmt: skip
    assert [point.hold for point in points if point.kind.value == "waypoint"] == [2, 2, 2]
    assert parts(await ears.download()) == parts(MISSION)
    assert vehicle.done == ["upload"]
    await ears.ask(mavlink.MAVLink_mission_request_message(1, 1, 0, 0), seconds=0.1)
    assert ears.named("MISSION_ITEM")[0].x == pytest.approx(LAT / 1e7, abs=1e-5)


@virtually
async def test_somebody_elses_list_is_read_from_the_board(vehicle, gateway, ears):
    await ears.upload(MISSION)
    vehicle.points = (MissionPoint(latitude_deg=LAT / 1e7, longitude_deg=LON / 1e7, altitude=7.0, heading_deg=90),)
    event = {"action": "uploaded", "count": 1, "digest": "another", "source": "file"}
    gateway.value_arrived(MissionEvent(stamp=STAMP, **event))
    (found,) = await ears.download()
    assert parts([found])[0] == (0, 6, 16, 1, 1, 0.0, 5.0, 0.0, LAT, LON, 7.0) and found.param4 == 90.0
    assert vehicle.done == ["upload", "read"]


@pytest.mark.parametrize(
    ("items", "result", "words"),
    [
        ([item(0), item(1, 22)], INVALID, "item 1: a take-off after the first point cannot be flown"),
        (
            [item(0), item(1, 2000)],
            UNSUPPORTED,
            "item 1: MikroKopter points cannot express command 2000 (pictures); use a camera trigger distance",
        ),
        ([item(0), item(1, 20), item(2)], INVALID, "item 2: nothing can be flown after a return to launch"),
        ([item(0), item(1, frame=10)], FRAME, "item 1: frame 10 cannot be flown"),
        ([item(0, z=NAN)], INVALID, "item 0: altitude is not given"),
        ([item(0, params=(999.0, 0, 0, NAN))], INVALID, "item 0: hold is 999"),
        ([item(0, frame=6), item(1, frame=5)], INVALID, "altitudes are partly relative"),
        ([item(0, x=2_000_000_000)], INVALID, "item 0: latitude_deg is 200"),
        ([item(0, **SPEED)], INVALID, "no waypoint"),
    ],
)
@virtually
async def test_what_no_mikrokopter_can_do_is_refused_at_upload(vehicle, ears, items, result, words):
    assert await ears.upload(items) == [result]
    assert words in ears.words and vehicle.calls == []


@virtually
async def test_a_plan_of_qgroundcontrol_with_its_take_off_item_is_taken_and_the_words_are_whole(vehicle, ears):
    """Its default take-off item: pitch 0, no yaw, the place and height of the launch."""
    assert await ears.upload([item(0, 22), item(1), item(2, 20)]) == [ACCEPTED]
    assert ears.words.startswith("item 0: take-off is read as a waypoint: a NaviCtrl's list begins in the air")
    assert "item 2: return to launch: a NaviCtrl 0.24 flies home after the last point anyway" in ears.words
    assert len(vehicle.points) == 2 and len(await ears.download()) == 3


@virtually
async def test_heights_above_the_sea_are_heights_above_home(vehicle, ears):
    assert await ears.upload([item(0, frame=5, z=20.0)]) == [ACCEPTED]
    assert vehicle.points[0].altitude == 10.5
    async with serving(vehicle, values=()) as gateway:
        ears = Ears(gateway)
        assert await ears.upload([item(0, frame=5, z=20.0)]) == [INVALID] and "above sea level" in ears.words


@pytest.mark.parametrize(
    ("refusal", "result"),
    [
        (refuse(Token.POINT_UNUSUAL, detail="far"), DENIED),
        (refuse(Token.POINT_NOT_EXPRESSIBLE, number=2, detail="speed"), UNSUPPORTED),
        (refuse(Token.TOO_MANY_POINTS, detail="many", count=99, limit=31), NO_SPACE),
        (MkError("line"), ERROR),
    ],
)
@virtually
async def test_a_refusal_of_the_daemon_is_told(vehicle, ears, refusal, result):
    vehicle.refusals["upload"] = refusal
    assert await ears.upload([item(0)]) == [result]
    assert "the mission is not stored" in ears.words
    assert await ears.download() == []


@virtually
async def test_while_it_is_stored_the_last_item_is_asked_for_again(vehicle, ears):
    vehicle.slow = 4.0
    assert await ears.upload([item(0), item(1)], 5.0) == [ACCEPTED]
    assert [message.seq for message in ears.named("MISSION_REQUEST_INT")] == [0, 1, 1, 1, 1]
    assert len(vehicle.points) == 2


@virtually
async def test_a_lost_item_is_asked_for_again_and_an_upload_that_stops_is_ended(ears):
    ears.deaf_to = (1,)
    assert await ears.upload([item(0), item(1)], 8.0) == [CANCELLED]
    assert [message.seq for message in ears.named("MISSION_REQUEST_INT")] == [0, 1, 1, 1, 1, 1]
    ears.deaf_to = ()
    assert await ears.upload([item(0), item(1)]) == [ACCEPTED]


@virtually
async def test_one_upload_at_a_time(gateway):
    ears, other = Ears(gateway), Ears(gateway, program=(254, 190))
    ears.deaf_to = (0,)
    ears.say(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    assert await other.upload([item(0)], 0.1) == [DENIED]
    other.say(item(0))
    await beat(other, 0.1)
    assert other.results == [DENIED, SEQUENCE]
    await ears.ask(mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0), seconds=0.1)
    assert await other.upload([item(0)]) == [ACCEPTED]


@virtually
async def test_a_list_that_is_flown_is_neither_replaced_nor_cleared(vehicle, gateway, ears):
    gateway.value_arrived(rig.navi(NaviStage.ROUTE, waypoint=1))
    assert await ears.upload([item(0)]) == [ERROR]
    await ears.ask(mavlink.MAVLink_mission_clear_all_message(1, 1, 0), seconds=0.1)
    assert ears.results == [ERROR, DENIED]
    assert vehicle.calls == [] and "being flown" in ears.words


@virtually
async def test_without_a_navictrl_there_is_no_mission(vehicle, gateway, ears):
    gateway.value_arrived(rig.HEALTH.model_copy(update={"boards": ("fc",)}))
    assert await ears.download() == [] and vehicle.calls == []


@virtually
async def test_a_list_that_cannot_be_read(vehicle, ears):
    vehicle.refusals["read"] = refuse(Token.LIST_CHANGING)
    ears.say(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    await ears.ask(mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0), seconds=0.2)
    assert ears.results == [ERROR, ERROR]
    vehicle.refusals.clear()
    await ears.ask(mavlink.MAVLink_mission_request_int_message(1, 1, 7, 0), seconds=0.2)
    assert ears.results[-1] == SEQUENCE


@virtually
async def test_fences_rally_points_lists_in_part_and_too_many_items_are_none(ears):
    for message in (
        mavlink.MAVLink_mission_count_message(1, 1, 5000, 0),
        mavlink.MAVLink_mission_count_message(1, 1, 3, 1),
        mavlink.MAVLink_mission_count_message(1, 1, 0, 1),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 2),
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 1),
        *(mavlink.MAVLink_mission_request_list_message(1, 1, kind) for kind in (1, 2)),
    ):
        ears.say(message)
    await beat(ears, 0.1)
    acks = [(m.type, m.mission_type) for m in ears.named("MISSION_ACK")]
    assert acks == [(NO_SPACE, 0), (UNSUPPORTED, 1), (0, 1), (0, 2), (UNSUPPORTED, 0)]
    assert [(m.count, m.mission_type) for m in ears.named("MISSION_COUNT")] == [(0, 1), (0, 2)]


@virtually
async def test_where_it_is_in_its_list(gateway, ears):
    await ears.upload(MISSION)
    for stage, waypoint, done in (
        (NaviStage.READY, 1, False), (NaviStage.ROUTE, 2, False), (NaviStage.AT_POINT, 2, False),
        (NaviStage.AT_POINT, 5, True),
    ):  # fmt: skip
        gateway.value_arrived(rig.navi(stage, waypoint=waypoint, waypoints=5, is_route_done=done))
        gateway.value_arrived(rig.flight())
        await beat(ears, 1.05)
    shown = [(m.seq, m.total, m.mission_state, m.mission_mode) for m in ears.named("MISSION_CURRENT")]
    assert shown[-4:] == [(0, 5, 4, 2), (2, 5, 3, 1), (2, 5, 3, 1), (5, 5, 5, 1)]
    assert [message.seq for message in ears.named("MISSION_ITEM_REACHED")] == [2, 5]

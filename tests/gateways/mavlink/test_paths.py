"""Missions in a local frame, which are paths of the daemon: its own check of them, and a flight that is played."""

from __future__ import annotations

import asyncio
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.path.stored import StoredPaths
from mkdaemon.gateways.mavlink.missionitems import UnflyableError
from mkdaemon.gateways.mavlink.modes import Mode, Numbering
from mkdaemon.gateways.mavlink.paths import SPEED, points_of
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.mission import MissionPoint
from mkdaemon.telemetry.path import MOST_PIECES, PathFlown, PathUploadRequest
from tests.gateways.mavlink import rig
from tests.gateways.mavlink.rig import NAN, Ears, FakeVehicle, beat, parts, virtually

NED, ENU, GLOBAL = 1, 4, 6
ACCEPTED, ERROR, FRAME, UNSUPPORTED, NO_SPACE, INVALID = 0, 1, 2, 3, 4, 5
NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 2, 3, 4, 5
START, PAUSE, STAY, SET_MODE = 300, 193, 17, 176


def item(seq, north=0.0, east=0.0, down=-2.0, *, command=16, frame=NED, params=(0.0, 0.0, 0.0, NAN), more=1):
    return rig.item(seq, command, frame, params, (round(north * 1e4), round(east * 1e4), down), more)


def speed(seq, value, kind=1.0):
    return item(seq, down=0.0, command=178, frame=2, params=(kind, value, -1.0, 0.0))


SQUARE = [
    item(0, 0.5, 0.0, params=(1.0, 0.25, 0.0, NAN)),
    speed(1, 0.375),
    item(2, 0.0, 0.5, command=19, params=(2.0, 0.0, 0.0, NAN)),
    item(3, -0.5, 0.0),
    item(4, 0.5, 0.0),
]


class Daemon(FakeVehicle):
    """A vehicle whose daemon checks paths as the real one does, and flies as it is told to.

    Attributes:
        stored: the answers to uploads.
        request: the newest path.
    """

    def __init__(self):
        super().__init__()
        self.paths, self.stored = self, []
        self._kept = StoredPaths(AutopilotConfig())

    async def upload(self, points):
        await self.call("path", points)
        self.request = PathUploadRequest(points=points)
        self.stored.append(self._kept.upload(self.request, AircraftModel()))
        return self.stored[-1]


before_a_daemon = partial(virtually, kind=Daemon)


def flies(vehicle, gateway, progress, *, is_paused=False, **more):
    """Let the daemon report how far it is."""
    stored, now = vehicle.stored[-1], gateway.picture.boot_time
    at = {"stamp": Stamp(monotonic=now, wall=0.0), "id": stored.id, "target": "pad", "stage": "", "points": ()}
    gateway.value_arrived(rig.status(Phase.FLYING, epoch=rig.EPOCH, manoeuvre="path", **more))
    along = {"progress": progress, "left": stored.duration * (1.0 - progress), "rate": 1.0, "is_paused": is_paused}
    gateway.value_arrived(PathFlown(**at, **along))


def shown(ears):
    """Item, state and mode of the last MISSION_CURRENT."""
    last = ears.named("MISSION_CURRENT")[-1]
    return last.seq, last.mission_state, last.mission_mode


def reached(ears):
    return [message.seq for message in ears.named("MISSION_ITEM_REACHED")]


@before_a_daemon
async def test_it_is_uploaded_flown_paused_flown_on_and_held_at_its_end(vehicle, gateway, ears):
    assert await ears.upload(SQUARE) == [ACCEPTED]
    points = vehicle.request.points
    assert [point.position for point in points] == [(0, 0.5, 2), (0.5, 0, 2), (0, -0.5, 2), (0, 0.5, 2)]
    assert [(point.speed, point.stop, point.yaw) for point in points] == [
        (None, 1.0, None), (0.375, 2.0, None), (0.375, None, None), (0.375, None, None),
    ]  # fmt: skip
    assert parts(await ears.download()) == parts(SQUARE)
    await beat(ears, 1.0)
    assert shown(ears) == (0, NOT_STARTED, 2)
    await ears.order(START, seconds=1.0)
    assert ears.acks[-1] == (START, ACCEPTED)
    _, kind, fields = vehicle.setpoints[-1]
    stored = vehicle.stored[0]
    assert (kind, fields) == ("path", {"path": stored.id, "run": 1, "paused": False})
    flies(vehicle, gateway, 0.0)  # on the way to its first point
    await beat(ears, 1.0)
    assert (shown(ears), reached(ears)) == ((0, ACTIVE, 1), [])
    assert gateway._mode() is Mode.MISSION
    flies(vehicle, gateway, (stored.times[1] + 0.1) / stored.duration)
    await beat(ears, 1.0)
    assert (shown(ears), reached(ears)) == ((3, ACTIVE, 1), [0, 2])
    await ears.order(PAUSE, 0, seconds=0.2)
    assert vehicle.setpoints[-1][2]["paused"] is True
    flies(vehicle, gateway, 0.5, is_paused=True)
    await beat(ears, 1.0)
    assert shown(ears)[1:] == (PAUSED, 2) and gateway._mode() is Mode.HOLD
    await ears.order(PAUSE, 1, seconds=0.2)
    assert vehicle.setpoints[-1][2] == fields
    flies(vehicle, gateway, 1.0)
    await beat(ears, 0.5)
    vehicle.lease_now.report(Phase.FLYING, manoeuvre="path", is_done=True)
    await beat(ears, 1.0)
    assert vehicle.setpoints[-1][1] == "hold"
    assert (shown(ears), reached(ears)) == ((4, COMPLETE, 2), [0, 2, 3, 4])
    assert ears.acks == [(START, ACCEPTED), (PAUSE, ACCEPTED), (PAUSE, ACCEPTED)]
    await ears.order(START)
    assert vehicle.setpoints[-1][2] == fields | {"run": 2}


@before_a_daemon
async def test_the_mode_hold_pauses_and_mission_goes_on_as_mavsdk_and_qgroundcontrol_do_it(vehicle, gateway, ears):
    await ears.upload(SQUARE)
    await ears.order(SET_MODE, 1, 4, 4)
    flies(vehicle, gateway, 0.3)
    for sub_mode, is_paused in ((3, True), (4, False)):
        await ears.order(SET_MODE, 1, 4, sub_mode, seconds=0.3)
        assert vehicle.setpoints[-1][2]["paused"] is is_paused
        flies(vehicle, gateway, 0.3, is_paused=is_paused)
    assert {fields["run"] for _, _, fields in vehicle.setpoints} == {1}


@before_a_daemon
async def test_another_station_neither_replaces_nor_flies_it_but_may_hold(vehicle, gateway, ears):
    other = Ears(gateway, program=(254, 190))
    await ears.upload(SQUARE)
    await ears.order(START)
    flies(vehicle, gateway, 0.5)
    assert await other.upload([item(0), item(1, 1.0)]) == [ERROR]
    assert "being flown" in other.words
    other.command(START)
    await other.order(PAUSE, 1, seconds=0.3)
    assert sorted(other.acks) == [(PAUSE, 2), (START, 1)]
    assert vehicle.setpoints[-1][1] == "path" and len(vehicle.stored) == 1
    await beat(ears, 1.0)
    assert shown(ears)[1] == ACTIVE
    await other.order(STAY)
    assert vehicle.setpoints[-1][1] == "hold"


@before_a_daemon
async def test_it_leaves_the_list_of_the_navictrl_and_a_clear_shows_that_again(vehicle, gateway, ears):
    vehicle.points = (MissionPoint(latitude_deg=53.2, longitude_deg=7.4, altitude=7.0),)
    assert await ears.upload(SQUARE) == [ACCEPTED]
    assert len(await ears.download()) == 5
    await ears.ask(mavlink.MAVLink_mission_clear_all_message(1, 1, 0), seconds=0.2)
    assert ears.results[-1] == ACCEPTED
    (found,) = await ears.download()
    assert (found.frame, found.z) == (GLOBAL, 7.0)
    assert vehicle.done == ["path", "read"]


REFUSED = [
    ([SQUARE[0]], INVALID, "a path has at least two points"),
    ([item(k, k % 2) for k in range(MOST_PIECES + 1)], NO_SPACE, f"a path has at most {MOST_PIECES}"),
    ([*SQUARE[:1], item(1, command=22)], UNSUPPORTED, "no command 22 (take-off): take off by NAV_TAKEOFF"),
    ([*SQUARE[:1], item(1, command=21)], UNSUPPORTED, "no command 21 (land): land by NAV_LAND"),
    ([*SQUARE[:1], item(1, command=20, frame=2)], UNSUPPORTED, "no command 20 (return to launch): land by NAV_LAND"),
    ([*SQUARE[:1], item(1, command=2000, frame=2)], UNSUPPORTED, "no command 2000 (pictures): remove the item"),
    ([*SQUARE[:1], item(1, frame=GLOBAL)], FRAME, "item 1: frame 6 in a mission in a local frame"),
    ([*SQUARE[:1], item(1, down=NAN)], INVALID, "item 1: a place in a local frame needs x, y and z"),
    ([*SQUARE[:1], item(1, more=0)], INVALID, "item 1: the mission is to wait here"),
    ([*SQUARE[:1], item(1, params=(0, 0, 3, NAN))], INVALID, "item 1: pass radius 3"),
    ([*SQUARE[:1], item(1, params=(-1, 0, 0, NAN))], INVALID, "item 1: stop:"),
    ([*SQUARE[:1], speed(1, 0.5, kind=2.0), SQUARE[3]], INVALID, "item 1: kind of speed 2"),
    ([*SQUARE[:1], speed(1, 0.0), item(2)], INVALID, "item 2: speed:"),
]


@pytest.mark.parametrize(("items", "result", "words"), REFUSED)
def test_what_no_path_can_have_is_named(items, result, words):
    with pytest.raises(UnflyableError) as error:
        points_of(items, 0, 0)
    assert error.value.result == result and words in str(error.value)


@before_a_daemon
async def test_it_begins_with_its_first_item_only_and_again_after_an_abort_of_the_daemon(vehicle, gateway, ears):
    await ears.upload(SQUARE)
    await ears.order(START, 3, seconds=0.2)
    assert ears.acks == [(START, 2)] and vehicle.setpoints == []
    await ears.order(START)
    flies(vehicle, gateway, 0.5)
    gateway.value_arrived(rig.status(Phase.ABORTED, epoch=rig.EPOCH, manoeuvre="path", aborts=1))
    vehicle.lease_now.report(Phase.ABORTED, aborts=1)
    await ears.order(START)
    assert vehicle.setpoints[-1][2]["run"] == 2


def test_speeds_last_until_the_next_and_ardupilot_counts_airspeed_too():
    items = [item(number) for number in range(9)]
    items[1::2] = speed(1, 0.3), speed(3, -1.0), speed(5, -2.0), speed(7, 0.2, 0.0)
    points, flown = points_of(items, 1, 3)
    assert [point.speed for point in points] == [None, 0.3, 0.3, SPEED, 0.2]
    assert flown == (0, 2, 4, 6, 8)


@before_a_daemon
async def test_a_link_with_ardupilots_numbers_has_home_first_and_old_items_have_metres(vehicle, gateway):
    ears = Ears(gateway, Numbering.ARDUPILOT)
    old = [mavlink.MAVLink_mission_item_message(1, 1, k, NED, 16, 0, 1, 0, 0, 0, 0, 0.25, k, -2, 0) for k in (1, 2)]
    assert await ears.upload([item(0, frame=0), *old]) == [ACCEPTED]
    assert [point.position for point in vehicle.request.points] == [(1, 0.25, 2), (2, 0.25, 2)]
    assert vehicle.request.points[0].yaw is None
    await ears.ask(mavlink.MAVLink_mission_request_message(1, 1, 2, 0), seconds=0.1)
    assert (ears.named("MISSION_ITEM")[-1].x, ears.named("MISSION_ITEM")[-1].y) == (0.25, 2.0)
    await ears.order(START, 1, seconds=0.3)
    assert ears.acks[-1] == (START, ACCEPTED)


class Lossy(Ears):
    """A ground station behind a bad radio: what becomes of each item that it sends is drawn."""

    fates = ()

    def send_item(self, seq):
        fate, *self.fates = self.fates or ("sent",)
        sent = {"sent": (seq,), "lost": (), "twice": (seq, seq), "early": (seq + 1, seq), "late": (seq, seq - 1)}[fate]
        for each in sent:
            if each >= 0:
                super().send_item(each)


@settings(max_examples=8)
@given(fates=st.lists(st.sampled_from(["sent", "lost", "twice", "early", "late"]), max_size=8))
@before_a_daemon
async def test_items_that_are_lost_repeated_or_out_of_order_make_the_same_path(vehicle, gateway, fates):
    ears, other = Lossy(gateway), Ears(gateway, program=(254, 190))
    ears.fates = [fate for number, fate in enumerate(fates) if fate != "lost" or fates[max(number - 4, 0)] != "lost"]
    uploading = asyncio.create_task(ears.upload(SQUARE, 9.0))
    await asyncio.sleep(0.005)
    assert await other.upload(SQUARE[2:], 0.05) == [14]
    assert await uploading == [ACCEPTED]
    assert len(vehicle.stored) == 1
    assert [m.seq for m in await other.download()] == list(range(len(SQUARE)))

"""The gateway before a ground station, in virtual time: what it sends by itself, what it answers, what it flies."""

from __future__ import annotations

import asyncio
import threading
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.bus.codec import encoding_of
from mkdaemon.client import Sample
from mkdaemon.errors import MkError
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.texts import words_of
from mkdaemon.telemetry.control import Cause, CauseKind, Outcome, Phase, trouble_words
from mkdaemon.telemetry.event import LogEvent
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding, PreflightReport
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import Attitude
from tests.gateways.mavlink import rig
from tests.gateways.mavlink.rig import NAN, Ears, beat, serving, virtually
from tests.values import STAMP

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)
TAKE_OFF, LAND, RTL, REPOSITION, SET_MODE, ARM, START, HOLD, ROI = 22, 21, 20, 192, 176, 400, 300, 17, 195
STANDARD_MODE, PREARM = mavlink.MAV_CMD_DO_SET_STANDARD_MODE, mavlink.MAV_CMD_RUN_PREARM_CHECKS
ON_GROUND = rig.flight(is_flying=False)
STANDING = rig.flight(is_flying=False, motors_running=False)


def flying(gateway, kind):
    """The daemon says that it flies this for the gateway."""
    gateway.value_arrived(rig.status(Phase.FLYING, epoch=rig.EPOCH, manoeuvre=kind))


def on_a_thread(work):
    thread = threading.Thread(target=work)
    thread.start()
    return thread


@virtually
async def test_a_value_is_sent_on_while_the_loop_stands_still_and_what_it_announces_follows_on_the_loop(vehicle, ears):
    sample = Sample("state/attitude", rig.ATTITUDE.model_dump(), encoding_of(Attitude))
    on_a_thread(lambda: vehicle.take(sample)).join()
    assert len(ears.named("ATTITUDE")) == 1
    event = LogEvent(stamp=STAMP, level="warning", text="a wire is loose")
    sample = Sample("event/log", event.model_dump(), encoding_of(LogEvent))
    on_a_thread(lambda: vehicle.take(sample)).join()
    assert not ears.words
    await asyncio.sleep(0)
    assert "a wire is loose" in ears.words


@virtually
async def test_nothing_but_heartbeats_for_a_station_that_was_not_heard(gateway, ears):
    ears.station.forget()
    for _ in range(40):
        gateway.value_arrived(rig.ATTITUDE)
        await asyncio.sleep(0.05)
    assert {message.get_type() for message in ears.heard} == {"HEARTBEAT"}


@virtually
async def test_a_message_at_another_rate_never_and_as_before_and_in_data_streams_as_of_old(gateway, ears):
    attitude = mavlink.MAVLINK_MSG_ID_ATTITUDE
    for interval, wanted in ((500_000, 2), (-1, 0), (0, 20)):
        ears.command(511, attitude, interval)
        ears.heard.clear()
        await beat(ears, 1.0, lambda: gateway.value_arrived(rig.ATTITUDE))
        assert len(ears.named("ATTITUDE")) == pytest.approx(wanted, abs=1)
    ears.command(510, attitude)
    assert ears.named("MESSAGE_INTERVAL")[-1].interval_us == 40_000
    ears.command(511, 9999, 1000)
    ears.command(511, 0, 1000)
    ears.command(511, attitude, NAN)
    assert [result for _, result in ears.acks[-3:]] == [UNSUPPORTED, DENIED, DENIED]
    ears.say(mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_ALL, 0, 0))
    ears.heard.clear()
    await beat(ears, 1.0, lambda: gateway.value_arrived(rig.ATTITUDE))
    assert not ears.named("ATTITUDE")
    ears.say(mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_EXTRA1, 4, 1))
    await beat(ears, 2.0, lambda: gateway.value_arrived(rig.ATTITUDE))
    assert len(ears.named("ATTITUDE")) == pytest.approx(8, abs=1)


@virtually
async def test_what_a_ground_station_asks_at_its_connection_is_answered_at_once(ears):
    for number in (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, mavlink.MAVLINK_MSG_ID_CURRENT_MODE, 0, 42):
        ears.command(512, number)
    assert {result for _, result in ears.acks} == {ACCEPTED}
    assert ears.named("AUTOPILOT_VERSION")[0].flight_sw_version == 2 << 24 | 12 << 16 | 1 << 8 | 255
    ears.heard.clear()
    for number in (259, 280, 300, 261):  # camera, gimbal, protocol, storage: a MikroKopter has none
        ears.command(512, number, target=(1, 100))
    ears.command(521, 1, target=(1, 100))
    assert ears.acks == [*[(512, UNSUPPORTED)] * 4, (521, UNSUPPORTED)]
    ears.say(mavlink.MAVLink_timesync_message(0, 77))
    ears.say(mavlink.MAVLink_ping_message(1, 2, 0, 0))
    assert ears.named("TIMESYNC")[0].ts1 == 77 and ears.named("TIMESYNC")[0].tc1 > 0
    assert ears.named("PING")[0].target_system == 255


@virtually
async def test_nothing_is_answered_to_ourselves_or_others(gateway):
    ears = Ears(gateway, program=(1, 1))
    ears.command(512, 0)
    other = Ears(gateway)
    other.command(512, 0, target=(2, 1))
    other.say(mavlink.MAVLink_param_request_list_message(2, 1))
    await asyncio.sleep(0.1)
    assert ears.acks == other.acks == [] and not other.named("PARAM_VALUE")


@virtually
async def test_take_off_is_acknowledged_when_it_begins_and_streamed_until_the_station_is_silent(vehicle, gateway, ears):
    vehicle.engages = 40
    gateway.value_arrived(ON_GROUND)
    await ears.order(TAKE_OFF, *[NAN] * 6, 2.0, seconds=2.0)
    assert ears.acks[0] == (TAKE_OFF, IN_PROGRESS) and ears.acks[-1] == (TAKE_OFF, ACCEPTED)
    assert {(kind, fields["height"]) for _, kind, fields in vehicle.setpoints} == {("takeoff", 2.0)}
    flying(gateway, "takeoff")
    await asyncio.sleep(1.0)
    assert vehicle.lease_now is not None
    await asyncio.sleep(2.0)
    assert vehicle.lease_now is None and vehicle.done[-1] == "give back"
    assert "silent" in ears.words


@virtually
async def test_a_connection_or_a_gateway_that_ends_gives_the_aircraft_back_at_once(vehicle, gateway, ears):
    await ears.order(HOLD)
    assert gateway.steering.is_flying
    gateway.links.remove(ears.station)
    await asyncio.sleep(0.05)
    assert vehicle.lease_now is None
    async with serving(vehicle) as other:
        await Ears(other).order(HOLD)
        assert vehicle.lease_now is not None
    assert vehicle.lease_now is None


class Order(NamedTuple):
    """A command: what is acknowledged, called and streamed then, and the words of it ("" for none).

    `known` arrived before, `refused` is why the daemon refuses its first call, `link` has the station's numbers.
    """

    command: int
    params: tuple = ()
    result: int = ACCEPTED
    calls: tuple = ()
    kind: str | None = None
    fields: dict | None = None
    words: str | None = None
    refused: MkError | None = None
    known: tuple = ()
    link: Numbering = Numbering.PX4
    frame: int | None = None


LEASE = ("lease",)
HELD, SHUT, NO_DAEMON = refuse(Token.LEASE_HELD, holder="somebody", left=3.0), refuse(Token.GATE_SHUT), MkError("none")
ORDERS = {
    "a lease somebody holds": Order(LAND, (), REJECTED, LEASE, words=words_of(HELD), refused=HELD),
    "a gate that is shut": Order(LAND, (), DENIED, LEASE, words=words_of(SHUT), refused=SHUT),
    "no daemon": Order(LAND, (), FAILED, LEASE, words=words_of(NO_DAEMON), refused=NO_DAEMON),
    "armed already": Order(ARM, (1,), words=""),
    "disarmed already": Order(ARM, (0,), words="", known=(STANDING,)),
    "arm": Order(ARM, (1,), calls=("request",), words="", known=(STANDING,)),
    "arm, not enabled": Order(
        *(ARM, (1,), DENIED, ("request",)), refused=refuse(Token.NOT_ENABLED, name="x", option="y"), known=(STANDING,)
    ),
    "disarm by force": Order(ARM, (0, 21196), calls=("stop",), words=""),
    "disarm in flight": Order(ARM, (0,), DENIED, ("stop",), refused=refuse(Token.FLYING_STOP)),
    "a place of the local frame": Order(
        *(REPOSITION, (0, 0, 0, 0, 10_000, 20_000, -2), ACCEPTED, LEASE, "position"),
        *({"position": (2.0, 1.0, 2.0), "yaw": 1.5708},), frame=1,
    ),
    "a place to look at": Order(
        *(ROI, (0, 0, 0, 0, 10_000, 3_000, 0), ACCEPTED, LEASE, "position"),
        *({"position": (0.3, -0.2, 2.0), "yaw": 1.5708},), frame=1,
    ),
    "hold": Order(HOLD, (), ACCEPTED, LEASE, "hold"),
    "return": Order(RTL, known=(rig.navi(waypoints=0),)),
    "return, while it holds a list": Order(RTL, (), DENIED, words="holds 3 points", known=(rig.navi(waypoints=3),)),
    "QGroundControl's take-off, above the sea": Order(
        TAKE_OFF, (-1, 0, 0, NAN, NAN, NAN, 12.5), ACCEPTED, LEASE, "takeoff", {"height": 3.0}, link=Numbering.AS_PX4
    ),
    "QGroundControl's pause": Order(
        REPOSITION, (-1, 1, 0, NAN, NAN, NAN, NAN), ACCEPTED, LEASE, "hold", link=Numbering.AS_PX4
    ),
    "mode return": Order(SET_MODE, (1, 4, 5)),
    "mode RTL of ArduPilot": Order(SET_MODE, (1, 6), link=Numbering.ARDUPILOT),
    "mode mission": Order(SET_MODE, (1, 4, 4), calls=("start",)),
    "mode stabilized": Order(SET_MODE, (1, 7, 0)),
    "mode altitude": Order(SET_MODE, (1, 2, 0), DENIED),
    "mode position, without sticks": Order(SET_MODE, (1, 3, 0), DENIED),
    "mode offboard, without a stream": Order(SET_MODE, (1, 6, 0), DENIED),
    "mode hold": Order(SET_MODE, (1, 4, 3), ACCEPTED, LEASE, "hold"),
    "mode land, in one number": Order(SET_MODE, (1, 4 << 16 | 6 << 24), ACCEPTED, LEASE, "land"),
    "mode take-off": Order(SET_MODE, (1, 4, 2), ACCEPTED, LEASE, "takeoff"),
    "base mode stabilized": Order(SET_MODE, (16,)),
    "base mode auto": Order(SET_MODE, (4,), calls=("start",)),
    "base mode guided": Order(SET_MODE, (8,), ACCEPTED, LEASE, "hold"),
    "base mode test": Order(SET_MODE, (2,), DENIED),
    "standard mode mission": Order(STANDARD_MODE, (mavlink.MAV_STANDARD_MODE_MISSION,), calls=("start",)),
    **{f"command {number}": Order(number, (), DENIED) for number in (179, 178, 224, 241, 246, 185, 209)},
}  # fmt: skip


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
@virtually
async def test_a_command_is_done_or_refused_in_words(vehicle, gateway, order):
    vehicle.refusals = dict.fromkeys(order.calls, order.refused)
    for value in order.known:
        gateway.value_arrived(value)
    ears = Ears(gateway, order.link)
    await ears.order(order.command, *order.params, frame=order.frame)
    assert ears.acks[-1:] == [(order.command, order.result)] and vehicle.done == list(order.calls)
    assert ears.words or order.result != DENIED
    assert order.words is None or (order.words in ears.words and bool(order.words) == bool(ears.words))
    streamed = dict.fromkeys(kind for _, kind, _ in vehicle.setpoints)
    assert list(streamed) == [order.kind] * (order.kind is not None)
    assert (gateway.steering.order is None) == (order.kind is None)
    for name, wanted in (order.fields or {}).items():
        assert vehicle.setpoints[-1][2][name] == pytest.approx(wanted, abs=1e-3)


@virtually
async def test_a_landing_goes_on_when_its_station_has_ended_and_ends_well(vehicle, gateway, ears):
    """MAVSDK's own example ends when it has ordered the landing."""
    await ears.order(LAND, seconds=1.0)
    flying(gateway, "land")
    await asyncio.sleep(10.0)
    assert vehicle.lease_now is not None and asyncio.get_running_loop().time() - vehicle.setpoints[-1][0] < 0.2
    vehicle.lease_now.lose("it stands", outcome=Outcome.LANDED)
    await beat(ears, 0.2)
    assert ears.acks == [(LAND, ACCEPTED)] and "landed" in ears.words and gateway.steering.order is None


@virtually
async def test_the_same_command_is_done_once(vehicle, ears):
    vehicle.slow = 1.0
    ears.command(START)
    await ears.order(START, confirmation=1, seconds=1.5)
    assert ears.acks[0] == (START, IN_PROGRESS) and ears.acks[-1] == (START, ACCEPTED)
    await ears.order(START, confirmation=2, seconds=1.5)
    assert vehicle.done == ["start"] and ears.acks[-1] == (START, ACCEPTED)


@virtually
async def test_a_place_on_the_globe_is_the_navictrls(vehicle, ears):
    ears.command(REPOSITION, -1, 0, 0, NAN, 532_301_000, 74_600_000, 5.0, frame=6)
    await ears.order(REPOSITION, -1, 0, 0, 0.0, 532_301_000, 74_600_000, 19.5, frame=0, seconds=0.3)
    name, (place,), options = vehicle.calls[0]
    assert name == "target" and place == pytest.approx((66.8, 11.1, 5.0), abs=0.1) and options["heading_deg"] is None
    assert "coming home" in ears.words
    await ears.order(HOLD, seconds=0.3)
    await ears.order(REPOSITION, -1, 0, 0, 0.0, 532_301_000, 74_600_000, 19.5, frame=0, seconds=0.2)
    assert ears.acks[-1] == (REPOSITION, DENIED)


def offboard(north):
    """A position setpoint as MAVSDK sends it."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b100111111000, north, 0, -2, 0, 0, 0, 0, 0, 0, 0, 0
    )


@virtually
async def test_offboard_hands_each_setpoint_on_as_it_comes_and_repeats_none(vehicle, gateway, ears):
    await ears.order(SET_MODE, 1, 6, 0, seconds=0.2)
    assert ears.acks == [(SET_MODE, DENIED)] and not vehicle.setpoints
    ears.say(offboard(0.0))
    assert vehicle.calls == []  # a stream alone takes no lease
    ears.command(SET_MODE, 1, 6, 0)
    await beat(ears, 0.5, lambda: ears.say(offboard(1.0)))
    flying(gateway, "position")
    assert ears.acks[-1] == (SET_MODE, ACCEPTED)
    count = len(vehicle.setpoints)
    assert 8 <= count <= 10 and vehicle.setpoints[-1][2]["position"] == (0.0, 1.0, 2.0)
    await beat(ears, 1.0)  # its heart beats, its setpoints have stopped
    assert len(vehicle.setpoints) == count and vehicle.lease_now is not None
    vehicle.lease_now.lose("no setpoint for 1.0 s")
    await beat(ears, 0.1)
    assert vehicle.lease_now is None and "no setpoint for 1.0 s" in ears.words
    ears.say(offboard(1.0))
    assert len(vehicle.setpoints) == count


@virtually
async def test_setpoints_of_another_station_are_not_flown(vehicle, gateway):
    ears, other = Ears(gateway), Ears(gateway, program=(245, 190))
    ears.say(offboard(0.0))
    ears.command(SET_MODE, 1, 6, 0)
    await beat(ears, 0.5, lambda: ears.say(offboard(1.0)))
    vehicle.setpoints.clear()
    other.say(offboard(5.0))
    other.command(SET_MODE, 1, 6, 0)
    await beat(other, 0.1, lambda: other.say(offboard(5.0)))
    assert vehicle.setpoints == [] and other.acks == [(SET_MODE, REJECTED)]
    other.command(HOLD)  # but it may order hold
    await beat(other, 0.3)
    assert vehicle.setpoints[-1][1] == "hold"


@pytest.mark.parametrize(
    ("params", "kind"), [((1, 7, 0), "stick"), ((1, 3, 0), "velocity")], ids=["Stabilized", "Position"]
)
@virtually
async def test_a_hand_controller_flies_in_its_modes(vehicle, gateway, ears, params, kind):

    def sticks():
        ears.say(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))

    sticks()
    ears.command(SET_MODE, *params)
    await beat(ears, 0.5, sticks)
    flying(gateway, kind)
    assert ears.acks[-1] == (SET_MODE, ACCEPTED) and {which for _, which, _ in vehicle.setpoints} == {kind}
    await beat(ears, 1.0, sticks)
    assert ears.named("HEARTBEAT")[-1].custom_mode == params[1] << 16
    ears.say(mavlink.MAVLink_manual_control_message(2, 0, 0, 500, 0, 0))  # of another aircraft
    await asyncio.sleep(0.6)
    ears.command(SET_MODE, 1, 7, 0)  # no stream any more: the pilot has it
    await beat(ears, 0.1)
    assert vehicle.lease_now is None and ears.acks[-1] == (SET_MODE, ACCEPTED)


@virtually
async def test_the_checks_before_a_flight_are_told_one_by_one(vehicle, gateway, ears):
    checks = (("gps", CheckState.STANDS, Blocks.AUTONOMY), ("wind", CheckState.STANDS, Blocks.NOTHING),
              ("line", CheckState.PASSED, Blocks.LEASE))  # fmt: skip
    findings = tuple(
        Finding(name=name, state=state, blocks=blocks, token=None, reason=f"{name} is bad.", fix="Mend it.")
        for name, state, blocks in checks
    )
    vehicle.report = PreflightReport(is_ready=False, findings=findings)
    await ears.order(PREARM, seconds=0.2)
    assert ears.acks == [(PREARM, REJECTED)]  # the motors turn
    gateway.value_arrived(STANDING)
    ears.heard.clear()
    await ears.order(PREARM, seconds=0.2)
    assert ears.acks == [(PREARM, ACCEPTED)]
    told = [(message.text, message.severity) for message in ears.named("STATUSTEXT")]
    assert told == [("PreArm: gps: gps is bad. Mend it.", 4), ("PreArm: wind: wind is bad. Mend it.", 6)]


@virtually
async def test_trouble_is_told_by_the_daemons_log_then_each_further_cause_and_its_end(gateway, ears):

    async def trouble(*causes, left=None):
        made = tuple(Cause.of(kind, seconds=0.6, count=3, of=9, detail="late") for kind in causes)
        words = trouble_words(made, left)
        status = rig.status(Phase.FLYING, epoch=1, causes=made, trouble=words, releases_in=left, manoeuvre="hold")
        if causes and not ears.words:
            gateway.value_arrived(LogEvent(stamp=STAMP, level="warning", text=words))
        gateway.value_arrived(status)
        await asyncio.sleep(0)  # announced on the loop

    for left in (2.4, 2.2, 2.0):
        await trouble(CauseKind.NO_POSE, left=left)
    await trouble(CauseKind.NO_POSE, CauseKind.UNANSWERED, left=1.8)
    await trouble()
    await trouble()
    assert ears.words == (
        "NO POSE FOR 0.6 S, releases in 2.4 s"
        "NO POSE FOR 0.6 S, releases in 1.8 s: 3 of 9 link tests unanswered"
        "Gateway flies: hold"
    )


@virtually
async def test_a_height_or_a_heading_alone_is_flown_where_the_aircraft_is(vehicle, gateway):
    ears = Ears(gateway, Numbering.AS_PX4)
    await ears.order(REPOSITION, -1, 1, 0, NAN, NAN, NAN, 14.5, seconds=0.1)
    assert ears.acks == [(REPOSITION, DENIED)] and "by the target in sight" in ears.words
    await ears.order(REPOSITION, -1, 1, 0, NAN, NAN, NAN, NAN, seconds=1.0)
    assert vehicle.setpoints[-1][1] == "hold"
    for heading, height, wanted in ((NAN, 14.5, 5.0), (0.0, NAN, 2.0)):
        gateway.value_arrived(rig.ESTIMATE)
        await ears.order(REPOSITION, -1, 1, 0, heading, NAN, NAN, height)
        _, kind, fields = vehicle.setpoints[-1]
        assert (kind, fields["position"]) == ("position", (0.3, -0.2, pytest.approx(wanted)))
        assert fields["yaw"] == (None if heading != heading else pytest.approx(1.5708, abs=1e-4))

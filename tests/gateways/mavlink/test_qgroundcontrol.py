"""What QGroundControl sends, each message answered before QGroundControl stops waiting for the answer.

The rows are those of docs/mavlink.md, "What QGroundControl asks". Times and sequences: the named files of
github.com/mavlink/qgroundcontrol, master of 2026; a file holds the time-out under the name that follows it.
"""

from __future__ import annotations

import asyncio
import re
import struct
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import all as mavlink

from lab.places import ROOT
from mkdaemon.gateways.mavlink.metadata import COMPONENT_METADATA
from mkdaemon.gateways.mavlink.modes import Mode, Numbering, number_of
from mkdaemon.telemetry.mission import MissionPoint
from tests.gateways.mavlink import rig
from tests.gateways.mavlink.rig import NAN, Ears, FakeVehicle, beat, item, serving, virtually

ACCEPTED, DENIED, IN_PROGRESS = 0, 2, 5
SLOW = 0.7
"""Time that every call of the daemon takes here [s]."""
COMMAND = "src/Vehicle/Vehicle.h `_mavCommandAckTimeoutMSecs`"
MODE = "src/FirmwarePlugin/FirmwarePlugin.cc `_setFlightModeAndValidate`"
WAYPOINT = MissionPoint(latitude_deg=53.2302, longitude_deg=7.4591, altitude=10.0)


class Row(NamedTuple):
    """A message of QGroundControl.

    Attributes:
        what: it sends.
        waits: for the answer [s].
        source: file of QGroundControl, and the name of the time-out in it.
        ask: sends it.
        answer: whether what came answers it.
    """

    what: str
    waits: float
    source: str
    ask: object
    answer: object


def command(number, *params, frame=None):
    return lambda ears: ears.command(number, *params, frame=frame)


def say(make, *arguments):
    return lambda ears: ears.say(make(*arguments))


def acknowledged(number, *results):
    return lambda ears: (ears.acks or [(0, 0)])[-1] in [(number, result) for result in results or (ACCEPTED, DENIED)]


def came(name, count=1):
    return lambda ears: len(ears.named(name)) >= count


def requested(number, name, count=1):
    return lambda ears: acknowledged(512, ACCEPTED)(ears) and came(name, count)(ears)


def with_mode(mode):
    number = number_of(mode, Numbering.AS_PX4)
    return lambda ears: any(one.custom_mode == number for one in ears.named("HEARTBEAT"))


def ftp(opcode, data=b""):
    head = struct.pack("<HBBBBBxI", 1, 0, opcode, len(data), 0, 0, 0)
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list((head + data).ljust(251, b"\0")))


def upload(ears):
    """Sends the count, and each item as it is asked for, as `_handleMissionRequest` does."""
    ears.say(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    ears.say(item(0))


def set_mode(mode):
    return say(mavlink.MAVLink_set_mode_message, 1, 1, number_of(mode, Numbering.AS_PX4))


ROWS = (
    Row("REQUEST_MESSAGE AUTOPILOT_VERSION", 3.0, COMMAND,
        command(512, 148), requested(148, "AUTOPILOT_VERSION")),
    Row("REQUEST_MESSAGE AVAILABLE_MODES, all at once", 3.0, COMMAND, command(512, 435, 0),
        requested(435, "AVAILABLE_MODES", len(Mode))),
    Row("REQUEST_MESSAGE COMPONENT_METADATA", 3.0, COMMAND, command(512, COMPONENT_METADATA),
        requested(397, f"UNKNOWN_{COMPONENT_METADATA}")),
    Row("FILE_TRANSFER_PROTOCOL: open, burst, terminate", 1.0, "src/Vehicle/FTPManager.h `_ackOrNakTimeoutMsecs`",
        say(ftp, 4, b"general.json"), came("FILE_TRANSFER_PROTOCOL")),
    Row("PARAM_REQUEST_LIST", 5.0, "src/FactSystem/ParameterManager.h `kParamRequestListTimeoutMs`",
        say(mavlink.MAVLink_param_request_list_message, 1, 0), came("PARAM_VALUE")),
    Row("PARAM_REQUEST_READ", 1.0, "src/FactSystem/ParameterManager.h `kWaitForParamValueAckMs`",
        say(mavlink.MAVLink_param_request_read_message, 1, 1, b"GYRO_P", -1), came("PARAM_VALUE")),
    Row("PARAM_REQUEST_READ _HASH_CHECK", 1.0, "src/FactSystem/ParameterManager.h `kHashCheckTimeoutMs`",
        say(mavlink.MAVLink_param_request_read_message, 1, 1, b"_HASH_CHECK", -1), came("PARAM_ERROR")),
    Row("PARAM_SET", 1.0, "src/FactSystem/ParameterManager.h `kWaitForParamValueAckMs`",
        say(mavlink.MAVLink_param_set_message, 1, 1, b"GYRO_P", 81.0, mavlink.MAV_PARAM_TYPE_REAL32),
        came("PARAM_VALUE")),
    Row("MISSION_REQUEST_LIST", 1.5, "src/MissionManager/PlanManager.h `_ackTimeoutMilliseconds`",
        say(mavlink.MAVLink_mission_request_list_message, 1, 1, 0), came("MISSION_COUNT")),
    Row("MISSION_REQUEST_INT", 0.25, "src/MissionManager/PlanManager.h `_retryTimeoutMilliseconds`",
        say(mavlink.MAVLink_mission_request_int_message, 1, 1, 0, 0), came("MISSION_ITEM_INT")),
    Row("MISSION_COUNT, and each item", 1.5, "src/MissionManager/PlanManager.h `_ackTimeoutMilliseconds`",
        upload, came("MISSION_REQUEST_INT", 2)),
    Row("the last item", 1.5, "src/MissionManager/PlanManager.h `_ackTimeoutMilliseconds`",
        lambda ears: (upload(ears), ears.say(item(1))), came("MISSION_ACK")),
    Row("MISSION_CLEAR_ALL", 1.5, "src/MissionManager/PlanManager.h `_ackTimeoutMilliseconds`",
        say(mavlink.MAVLink_mission_clear_all_message, 1, 1, 0), came("MISSION_ACK")),
    Row("take-off: NAV_TAKEOFF, height above the sea", 3.0, COMMAND,
        command(22, -1, 0, 0, NAN, NAN, NAN, 14.5), acknowledged(22, ACCEPTED, IN_PROGRESS, DENIED)),
    Row("then COMPONENT_ARM_DISARM", 3.0, COMMAND, command(400, 1), acknowledged(400)),
    Row("pause: DO_REPOSITION without a place", 3.0, COMMAND,
        command(192, -1, 1, 0, NAN, NAN, NAN, NAN), acknowledged(192, ACCEPTED, IN_PROGRESS)),
    Row("change the height: DO_REPOSITION with a height alone", 3.0, COMMAND,
        command(192, -1, 1, 0, NAN, NAN, NAN, 14.5), acknowledged(192)),
    Row("turn: DO_REPOSITION with a heading alone", 3.0, COMMAND,
        command(192, -1, 1, 0, 1.5, NAN, NAN, NAN), acknowledged(192)),
    Row("go-to: COMMAND_INT DO_REPOSITION", 3.0, COMMAND,
        command(192, -1, 1, 0, NAN, 532_301_184, 74_590_749, 14.5, frame=0), acknowledged(192, ACCEPTED, IN_PROGRESS)),
    Row("change the speed: DO_CHANGE_SPEED", 3.0, COMMAND,
        command(178, 1, 3, -1, 0, NAN, NAN, NAN), acknowledged(178, DENIED)),
    Row("region of interest: DO_SET_ROI_LOCATION", 3.0, COMMAND,
        command(195, 0, 0, 0, 0, 532_301_184, 74_590_749, 14.5, frame=0), acknowledged(195, DENIED)),
    Row("land, hold: SET_MODE", 1.3, MODE, set_mode(Mode.LAND), with_mode(Mode.LAND)),
    Row("return, mission: SET_MODE", 1.3, MODE, set_mode(Mode.RETURN), acknowledged(176)),
    Row("emergency stop: COMPONENT_ARM_DISARM, forced", 3.0, COMMAND,
        command(400, 0, 21_196), acknowledged(400)),
    Row("logs: LOG_REQUEST_LIST", 5.0, "src/AnalyzeView/OnboardLogs/LogProtocolTransport.h `kRequestLogListTimeout`",
        say(mavlink.MAVLink_log_request_list_message, 1, 1, 0, 0xFFFF), came("LOG_ENTRY")),
    Row("a log: LOG_REQUEST_DATA", 0.5, "src/AnalyzeView/OnboardLogs/LogProtocolTransport.h `kTimeout`",
        say(mavlink.MAVLink_log_request_data_message, 1, 1, 0, 0, 46_080), came("LOG_DATA")),
)  # fmt: skip
KNOWN_BEFORE = {"PARAM_REQUEST_READ", "PARAM_SET", "MISSION_REQUEST_INT"}
"""What QGroundControl asks only after it has read the whole list."""
ON_GROUND = {"emergency stop: COMPONENT_ARM_DISARM, forced", "a log: LOG_REQUEST_DATA", "logs: LOG_REQUEST_LIST"}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.what)
@virtually
async def test_each_is_answered_before_its_time_out(tmp_path, row):
    fake = FakeVehicle()
    fake.slow, fake.points = SLOW, (WAYPOINT,)
    flight = rig.flight(is_flying=False, motors_running=row.what not in ON_GROUND)
    async with serving(fake, folder=tmp_path, values=(*rig.EVERYTHING, flight)) as gateway:
        ears = Ears(gateway, Numbering.AS_PX4)
        if row.what in KNOWN_BEFORE:
            ears.say(mavlink.MAVLink_param_request_list_message(1, 0))
            await ears.ask(mavlink.MAVLink_mission_request_list_message(1, 1, 0), seconds=3.0)
        ears.heard.clear()
        began = asyncio.get_running_loop().time()
        row.ask(ears)
        while not row.answer(ears):
            assert asyncio.get_running_loop().time() - began < row.waits, (row.what, ears.acks, ears.words)
            if fake.lease_now is not None and fake.lease_now.session.status is not None:
                gateway.value_arrived(fake.lease_now.session.status)  # as the daemon publishes it
            await beat(ears, 0.05)


def test_the_page_has_the_same_rows():
    page = (ROOT / "docs" / "mavlink.md").read_text(encoding="utf-8")
    table = page.partition("### What QGroundControl asks")[2]
    lines = [re.split(r" *\| *", line.strip("| ")) for line in table.splitlines() if line.startswith("|")][2:]
    shown = [(what, waits, source) for what, waits, _, source in lines]
    assert shown == [(row.what, f"{row.waits:g} s", f"`{row.source.replace(' `', '`, `', 1)}") for row in ROWS]

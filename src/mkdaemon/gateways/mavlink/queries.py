"""What a ground station asks to know: versions, single messages, rates; and what no MikroKopter has.

Queries to a component that does not exist (camera, gimbal) get an answer, so that no station waits for a time-out.
Sources: https://mavlink.io/en/messages/common.html (MAV_CMD_REQUEST_MESSAGE), services/timesync.html
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from mkdaemon.gateways.mavlink.commands import ACCEPTED, UNSUPPORTED, Asked, CommandAnswered, Handler, denied
from mkdaemon.gateways.mavlink.dialect import BROADCAST, Message, mavlink
from mkdaemon.gateways.mavlink.metadata import COMPONENT_METADATA, GENERAL, ComponentMetadata, FileServer, documents
from mkdaemon.gateways.mavlink.modes import ROWS, Mode, available_mode, current_mode, heartbeat
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.stations import By, Station, Take
from mkdaemon.gateways.mavlink.telemetry import GROUPS, IDS, TABLE
from mkdaemon.telemetry.vehicle import VehicleHealth

_CAPABILITIES: Final = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_FASTEST: Final = 0.002
"""Shortest period that is kept as asked [s]; no source is that fast."""
_HEARTBEAT: Final = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_VERSION: Final = int(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
_HOME: Final = int(mavlink.MAVLINK_MSG_ID_HOME_POSITION)


class Queries:
    """Answers questions.

    Attributes:
        takes: what answers a message that is no command, by its name.
    """

    def __init__(
        self,
        picture: LinkPicture,
        mode: Callable[[], Mode],
        mission: Callable[[], Message],
        revision: Callable[[], int],
    ) -> None:
        """Answer from what is known.

        Args:
            picture: what is known of the aircraft.
            mode: what it does now.
            mission: MISSION_CURRENT of now.
            revision: of the settings that the parameters are made of.
        """
        self._picture, self._mode, self._mission, self._revision = picture, mode, mission, revision
        self._files = FileServer()
        self.takes: dict[str, Take] = {
            "FILE_TRANSFER_PROTOCOL": self._files.take,
            "TIMESYNC": self._answer_time,
            "PING": _answer_ping,
            "REQUEST_DATA_STREAM": _ask_group,
        }

    def table(self) -> dict[int, Handler]:
        """Handlers by the number of the command."""
        return {
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda asked: self._send(asked, _VERSION),
            mavlink.MAV_CMD_GET_HOME_POSITION: lambda asked: self._send(asked, _HOME),
            mavlink.MAV_CMD_REQUEST_MESSAGE: self.request,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self.set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self.get_interval,
        }

    def request(self, asked: Asked) -> CommandAnswered:
        """REQUEST_MESSAGE: one message, now."""
        return self._send(asked, int(asked.number(1) or 0), int(asked.number(2) or 0))

    def _send(self, asked: Asked, number: int, index: int = 0) -> CommandAnswered:
        station = asked.by.station
        if number == mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES:
            wanted = range(1, len(ROWS) + 1) if index == 0 else (index,)
            found = [available_mode(one, station.numbering) for one in wanted]
        elif number == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self.get_interval(asked, index)
        else:
            made = self._single(station, number)
            if made is None:
                return UNSUPPORTED
            found = [made()]
        if None in found:
            return denied("the aircraft does not say that now")
        for message in found:
            station.send(message)
        return ACCEPTED

    def _single(self, station: Station, number: int) -> Callable[[], Message | None] | None:
        """What makes a message; None for one that is never sent."""
        picture = self._picture
        single: dict[int, Callable[[], Message | None]] = {
            _HEARTBEAT: lambda: heartbeat(picture, self._mode(), station.numbering),
            _VERSION: lambda: autopilot_version(picture),
            int(mavlink.MAVLINK_MSG_ID_CURRENT_MODE): lambda: current_mode(self._mode(), station.numbering),
            int(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT): self._mission,
            COMPONENT_METADATA: self._metadata,
        }
        name = IDS.get(number)
        return single.get(number) if name is None else lambda: TABLE[name].make(picture)

    def _metadata(self) -> Message:
        """COMPONENT_METADATA; the files that it names stay until they are named again."""
        self._files.files = documents(self._revision())
        return ComponentMetadata(int(self._picture.boot_time * 1000) & 0xFFFF_FFFF, self._files.files[GENERAL])

    def set_interval(self, asked: Asked) -> CommandAnswered:
        """SET_MESSAGE_INTERVAL: microseconds; -1 for never, 0 for as it was."""
        number, wish = int(asked.number(1) or 0), asked.number(2)
        name = IDS.get(number)
        if name is None:
            return denied("a heartbeat comes once a second") if number == _HEARTBEAT else UNSUPPORTED
        if wish is None or wish < -1:
            return denied("an interval is microseconds, -1 for never, 0 for as it was")
        if wish == 0:
            asked.by.station.wish_for.pop(name, None)
        else:
            asked.by.station.ask(name, 0.0 if wish < 0 else max(wish * 1e-6, _FASTEST))
        return ACCEPTED

    def get_interval(self, asked: Asked, number: int | None = None) -> CommandAnswered:
        """GET_MESSAGE_INTERVAL: MESSAGE_INTERVAL follows; of one that is never sent -1, of an unknown one 0."""
        wanted = int(asked.number(1) or 0) if number is None else number
        name = IDS.get(wanted)
        interval = 0
        if wanted == _HEARTBEAT:
            interval = 1_000_000
        elif name is not None:
            interval = round(1e6 * asked.by.station.interval(name)) or -1
        asked.by.station.send(mavlink.MAVLink_message_interval_message(wanted & 0xFFFF, interval))
        return ACCEPTED

    def _answer_time(self, by: By, message: Message) -> None:
        if message.tc1 == 0:  # else it is an answer
            by.send(mavlink.MAVLink_timesync_message(int(self._picture.boot_time * 1e9), message.ts1))


def _answer_ping(by: By, message: Message) -> None:
    if message.target_system == BROADCAST:  # else it is an answer
        by.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *by.program))


def _ask_group(by: By, message: Message) -> None:
    """REQUEST_DATA_STREAM: a group of messages at one rate, or none of them."""
    group = message.req_stream_id
    names = tuple(TABLE) if group == mavlink.MAV_DATA_STREAM_ALL else GROUPS.get(group, ())
    for name in names:
        if not message.start_stop:
            by.station.ask(name, 0.0)
        elif message.req_message_rate:
            by.station.ask(name, max(1.0 / message.req_message_rate, _FASTEST))


def autopilot_version(picture: LinkPicture) -> Message:
    """AUTOPILOT_VERSION: the release of the FlightCtrl; a MikroKopter has none."""
    health = picture.get(VehicleHealth)
    words = "" if health is None else health.firmware.get("fc", "")
    custom = words.encode("ascii", "replace")[:8].ljust(8, b"\0")
    return mavlink.MAVLink_autopilot_version_message(
        _CAPABILITIES, _version(words), 0, 0, 0, list(custom), [0] * 8, [0] * 8, 0, 0, 0
    )


def _version(words: str) -> int:
    """A release such as `2.12a` as MAVLink has it: a byte each for major, minor, patch and type; 0 while unknown."""
    found = re.search(r"(\d+)\.(\d+)([a-z]?)", words)
    if found is None:
        return 0
    patch = ord(found[3]) - ord("a") + 1 if found[3] else 0
    official = int(mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL)
    return (int(found[1]) & 0xFF) << 24 | (int(found[2]) & 0xFF) << 16 | patch << 8 | official

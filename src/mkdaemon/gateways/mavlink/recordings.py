"""The log protocol: the daemon's recordings, listed and sent, where they are on this machine.

Source: https://mavlink.io/en/messages/common.html#LOG_REQUEST_LIST. A recording is sent while the motors stand, as
ArduPilot does it; nothing is erased.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.modes import Numbering, is_armed
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.stations import Program, Station
from mkdaemon.gateways.mavlink.texts import Notify
from mkdaemon.record.folder import origin_of, recordings_of
from mkdaemon.telemetry.record import RecordStatus

MESSAGES: Final = frozenset({"LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE"})
_ROOM: Final = 90
"""Bytes of a recording in one message."""
_AT_ONCE: Final = 20
"""Messages that are sent without a pause; 360 kB/s in all. What a slow radio loses is asked for again."""
PACE: Final = 0.005
"""Between two of those [s]."""
_MOST_LISTED: Final = 1000


class Log(NamedTuple):
    """A recording.

    Attributes:
        path: of its file.
        start: Unix time [s].
        size: [bytes], when it was listed.
    """

    path: Path
    start: int
    size: int


def listed(current: Path) -> list[Log]:
    """The recordings beside one, oldest first, at most 1000; none where its folder is not of this machine.

    Args:
        current: the file that the daemon writes.
    """
    origin = origin_of(current)
    found = []
    for path in () if origin is None else recordings_of(current.parent, origin[0])[-_MOST_LISTED:]:
        named = origin_of(path)
        try:
            size = path.stat().st_size
        except OSError:  # deleted meanwhile
            continue
        found.append(Log(path, 0 if named is None else int(named[1]), min(size, 0xFFFF_FFFF)))
    return found


class LogServer:
    """Answers the log protocol."""

    def __init__(self, picture: LinkPicture, notify: Notify) -> None:
        """Serve recordings.

        Args:
            picture: what is known of the aircraft.
            notify: tells a ground station why.
        """
        self._picture, self._notify = picture, notify
        self._logs: list[Log] = []
        self._sending: dict[tuple[Station, Program], int] = {}
        self._number = 0

    async def take(self, station: Station, message: Message) -> None:
        """Answer a message of the protocol."""
        whose = station, Program(message.get_srcSystem(), message.get_srcComponent())
        first = 1 if station.numbering is Numbering.ARDUPILOT else 0  # each counts its logs so
        match message.get_type():
            case "LOG_REQUEST_LIST":
                await self._list(station, message.start - first, message.end - first, first)
            case "LOG_REQUEST_DATA":
                await self._send(whose, message, first)
            case "LOG_REQUEST_END":
                self._sending.pop(whose, None)
            case "LOG_ERASE":
                self._notify(station, "recordings are not erased from here: the daemon deletes the oldest")

    async def _list(self, station: Station, start: int, end: int, first: int) -> None:
        status = self._picture.get(RecordStatus)
        if status is not None and status.file and not is_armed(self._picture):  # the disk may be slow
            self._logs = listed(Path(status.file))
        last = max(len(self._logs) - 1, 0) + first
        wanted = [(number, log) for number, log in enumerate(self._logs) if start <= number <= end]
        for number, log in wanted:
            station.send(mavlink.MAVLink_log_entry_message(number + first, len(self._logs), last, log.start, log.size))
            if number % _AT_ONCE == _AT_ONCE - 1:
                await asyncio.sleep(PACE)
        if not self._logs:
            self._notify(station, "no recordings: the gateway lists those on its machine while the daemon records")
            station.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    async def _send(self, whose: tuple[Station, Program], message: Message, first: int) -> None:
        """Send a part of a recording; a further request of the same program takes its place."""
        station, number = whose[0], message.id - first
        self._number = mine = self._number + 1
        if is_armed(self._picture):
            self._notify(station, "recordings are sent only while the motors are off")
            return
        if not 0 <= number < len(self._logs):
            station.send(_data(message.id, message.ofs, b""))
            return
        log = self._logs[number]
        self._sending[whose] = mine
        at, end = message.ofs, min(message.ofs + message.count, log.size)
        while self._sending.get(whose) == mine and station.is_open and not is_armed(self._picture):
            parts = _parts(log.path, at, end)
            for part in parts:
                station.send(_data(message.id, at, part))
                at += len(part)
            if at >= end or not parts:
                if at >= log.size and at % _ROOM == 0:  # a full last part would not say that it is the last
                    station.send(_data(message.id, at, b""))
                break
            await asyncio.sleep(PACE)
        if self._sending.get(whose) == mine:
            del self._sending[whose]


def _parts(path: Path, at: int, end: int) -> list[bytes]:
    """The next parts of a file; none where it was deleted."""
    try:
        with path.open("rb") as file:
            file.seek(at)
            data = file.read(min(end - at, _AT_ONCE * _ROOM))
    except OSError:
        return []
    return [data[start : start + _ROOM] for start in range(0, len(data), _ROOM)]


def _data(number: int, at: int, part: bytes) -> Message:
    return mavlink.MAVLink_log_data_message(number, at, len(part), list(part.ljust(_ROOM, b"\0")))

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
from mkdaemon.gateways.mavlink.stations import By, Station, Take
from mkdaemon.gateways.mavlink.texts import Notify
from mkdaemon.record.folder import origin_of, recordings_of
from mkdaemon.telemetry.record import RecordStatus

_ROOM: Final = 90
"""Bytes of a recording in one message."""
_AT_ONCE: Final = 20
"""Messages that are sent without a pause; 360 kB/s in all. What a slow radio loses is asked for again."""
PACE: Final = 0.005
"""Between two of those [s]."""
_MOST_LISTED: Final = 1000
_KEPT: Final = "recordings are not erased from here: the daemon deletes the oldest"


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
    """Answers the log protocol.

    Attributes:
        takes: what answers a message, by its name.
    """

    def __init__(self, picture: LinkPicture, notify: Notify) -> None:
        """Serve recordings.

        Args:
            picture: what is known of the aircraft.
            notify: tells a ground station why.
        """
        self._picture, self._notify = picture, notify
        self._logs: list[Log] = []
        self._sending: dict[By, int] = {}
        self._number = 0
        self.takes: dict[str, Take] = {
            "LOG_REQUEST_LIST": self._list,
            "LOG_REQUEST_DATA": self._send,
            "LOG_REQUEST_END": self._stop,
            "LOG_ERASE": lambda by, _: notify(by.station, _KEPT),
        }

    async def _list(self, by: By, message: Message) -> None:
        first = _first(by.station)
        status = self._picture.get(RecordStatus)
        if status is not None and status.file and not is_armed(self._picture):  # the disk may be slow
            self._logs = listed(Path(status.file))
        last = max(len(self._logs) - 1, 0) + first
        for number, log in enumerate(self._logs, first):
            if message.start <= number <= message.end:
                by.send(mavlink.MAVLink_log_entry_message(number, len(self._logs), last, log.start, log.size))
                if number % _AT_ONCE == 0:
                    await asyncio.sleep(PACE)
        if not self._logs:
            self._notify(by.station, "no recordings: the gateway lists those on its machine while the daemon records")
            by.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    def _stop(self, by: By, _: Message) -> None:
        self._sending.pop(by, None)

    async def _send(self, by: By, message: Message) -> None:
        """Send a part of a recording; a further request of the same program takes its place."""
        number = message.id - _first(by.station)
        self._number = mine = self._number + 1
        if is_armed(self._picture):
            self._notify(by.station, "recordings are sent only while the motors are off")
            return
        if not 0 <= number < len(self._logs):
            by.send(_data(message.id, message.ofs, b""))
            return
        log = self._logs[number]
        self._sending[by] = mine
        at, end = message.ofs, min(message.ofs + message.count, log.size)
        while self._sending.get(by) == mine and by.station.is_open and not is_armed(self._picture):
            parts = _parts(log.path, at, end)
            for part in parts:
                by.send(_data(message.id, at, part))
                at += len(part)
            if at >= end or not parts:
                if at >= log.size and at % _ROOM == 0:  # a full last part would not say that it is the last
                    by.send(_data(message.id, at, b""))
                break
            await asyncio.sleep(PACE)
        if self._sending.get(by) == mine:
            del self._sending[by]


def _first(station: Station) -> int:
    """Number of the first recording: each kind of ground station counts its logs so."""
    return 1 if station.numbering is Numbering.ARDUPILOT else 0


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

"""The parameter protocol: the active set of the FlightCtrl, read whole, written one by one, and the gateway's own.

A value is a byte and is sent as REAL32, the one type that every program decodes alike, whatever autopilot it takes this
one for. Sets are read while the motors stand; a write goes the way of `mkctl settings write` (backup first, then write,
read back and compare, by the daemon) and is refused in flight. Source: https://mavlink.io/en/services/parameter.html
"""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.gateways.boardset import GatewaySettings
from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.parameterids import NEWEST, ParameterId, change_to, ids_of, value_of
from mkdaemon.gateways.mavlink.stations import By, Station, Take
from mkdaemon.gateways.mavlink.texts import Notify, words_of

ACTIVE: Final = "MK_ACTIVE_SET"
"""Number of the active set; 0 while the sets have not been read."""
TAKE_OFF: Final = "MIS_TAKEOFF_ALT"
"""Height of a take-off whose command names none [m], under PX4's name; kept while the gateway runs."""
_OWN: Final = (ParameterId(ACTIVE, "", None), ParameterId(TAKE_OFF, "", None))
"""Parameters that are no settings: always there, before all others."""
_RETURN: Final = ParameterId("RTL_RETURN_ALT", "coming_home_altitude", None)
"""Of a link that says PX4: MAVSDK asks for the height of a return by this name."""
TAKE_OFF_HEIGHT: Final = 2.0
"""Height of a take-off that names none, at first [m]."""
FRESH: Final = 10.0
"""A set is read again for a list if it is older than this [s]: the pilot may have chosen another one."""
PACE: Final = 0.005
"""Between two values of a list [s]: a hundred at once would be lost by a radio."""
OLD_VALUE: Final = 0.8
"""A write that takes longer is answered with the value as it still is [s].

The new value follows when the board has answered that it has stored it, after 1.7 s, and again when it has been read
back, after 5 s. QGroundControl waits 1 s and asks three times (`src/FactSystem/ParameterManager.h`,
`kWaitForParamValueAckMs`); MAVSDK 4.1 asks for 3 s and then gives up.
"""
_TINY: Final = 1e-30
"""A float below this is a whole number whose bits were put there (`MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE`)."""


class ParameterServer:
    """Answers the parameter protocol.

    Attributes:
        take_off_height: of a take-off whose command names none [m].
        takes: what answers a message, by its name.
    """

    def __init__(self, uav: Vehicle, backups: Path, notify: Notify, now: Callable[[], float]) -> None:
        """Serve parameters.

        Args:
            uav: the vehicle.
            backups: folder in which the set is saved before it is first changed.
            notify: tells a ground station why.
            now: the clock [s].
        """
        self._set, self._notify, self._now = GatewaySettings(uav, lambda: backups), notify, now
        self.take_off_height = TAKE_OFF_HEIGHT
        self._read_at = -math.inf
        self._reading: asyncio.Task[None] | None = None
        self._writing: set[tuple[str, int]] = set()
        self._lock = asyncio.Lock()
        self.takes: dict[str, Take] = {
            "PARAM_REQUEST_LIST": self._send_all,
            "PARAM_REQUEST_READ": self._send_one,
            "PARAM_SET": self._write,
        }

    def forget(self) -> None:
        """Another client has changed the sets: read them again for the next list."""
        self._read_at = -math.inf

    @property
    def revision(self) -> int:
        """Revision of the active set; the newest that is known while it was not read."""
        stored = self._set.stored
        return NEWEST if stored is None else stored.revision

    async def _read_for(self, by: By, message: Message) -> None:
        """Read the active set once for a message that names a setting."""
        if not self._set.slot and _index(_OWN, _name(message)) is None:
            await self._read(by.station)

    async def _read(self, station: Station) -> None:
        """Read the active set where that was long ago; several that ask meanwhile wait for the same reading."""
        if self._now() - self._read_at < FRESH:
            return
        if self._reading is None or self._reading.done():
            self._reading = asyncio.create_task(self._read_now(), name="reading of settings")
        try:
            await asyncio.shield(self._reading)
        except MkError as error:
            what = "the settings are those read before" if self._set.slot else "no settings yet"
            self._notify(station, f"{what}: {words_of(error)}")

    async def _read_now(self) -> None:
        async with self._lock:
            await self._set.read()
            self._read_at = self._now()

    def _rows(self, station: Station) -> tuple[ParameterId, ...]:
        stored = self._set.stored
        if stored is None:
            return _OWN
        settings = ids_of(stored.revision)
        has_return = station.numbering is Numbering.AS_PX4 and any(row.name == _RETURN.name for row in settings)
        return (*_OWN, *((_RETURN,) if has_return else ()), *settings)

    async def _send_all(self, by: By, _: Message) -> None:
        await self._read(by.station)
        rows = self._rows(by.station)
        for index in range(len(rows)):
            self._send(by, index, rows)
            await asyncio.sleep(PACE)

    def _send(self, by: By, index: int, rows: tuple[ParameterId, ...], value: float | None = None) -> None:
        by.send(
            mavlink.MAVLink_param_value_message(
                rows[index].id.encode(),
                float(self._value(rows[index]) if value is None else value),
                mavlink.MAV_PARAM_TYPE_REAL32,
                len(rows),
                index,
            )
        )

    def _value(self, row: ParameterId) -> float:
        if row.id == TAKE_OFF:
            return self.take_off_height
        stored = self._set.stored
        return self._set.slot if row.id == ACTIVE or stored is None else value_of(stored, row)

    async def _send_one(self, by: By, message: Message) -> None:
        if message.param_index < 0:
            await self._read_for(by, message)
        rows = self._rows(by.station)
        index = message.param_index if message.param_index >= 0 else _index(rows, _name(message))
        if index is None or index >= len(rows):
            _refuse(by, message, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST)
            return
        self._send(by, index, rows)

    async def _write(self, by: By, message: Message) -> None:
        """Write a parameter; what it is then is sent in any case, and the words of a refusal with it."""
        await self._read_for(by, message)
        rows = self._rows(by.station)
        index = _index(rows, _name(message))
        if index is None:
            _refuse(by, message, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST)
            return
        if rows[index].id == TAKE_OFF:
            if math.isfinite(message.param_value) and message.param_value > 0.0:
                self.take_off_height = message.param_value
            else:
                self._notify(by.station, f"{TAKE_OFF}: a height above the target [m], more than 0")
                _refuse(by, message, mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)
            self._send(by, index, rows)
            return
        value = _whole(message)
        if index == 0 or value is None:
            error = mavlink.MAV_PARAM_ERROR_READ_ONLY if index == 0 else mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
            why = "the pilot chooses the active set" if index == 0 else "a setting is a whole number of 0 to 255"
            self._notify(by.station, f"{rows[index].id}: {why}")
            _refuse(by, message, error)
        else:
            wanted = (rows[index].id, value)
            if wanted in self._writing:  # asked again, for it takes longer than its sender waits
                return
            self._writing.add(wanted)
            try:
                new = partial(self._send, by, index, rows, value)
                writing = asyncio.ensure_future(self._write_in_turn(rows[index], value, new))
                if not (await asyncio.wait({writing}, timeout=OLD_VALUE))[0]:
                    self._send(by, index, rows)
                await writing
            except MkError as refusal:
                self._notify(by.station, f"{rows[index].id} is not written: {words_of(refusal)}")
                _refuse(by, message, mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED)
            finally:
                self._writing.discard(wanted)
        self._send(by, index, rows)

    async def _write_in_turn(self, row: ParameterId, value: int, on_stored: Callable[[], None]) -> None:
        async with self._lock:
            stored = self._set.stored
            if stored is None:
                raise MkError("the settings have not been read")
            await self._set.write(row.name, change_to(stored, row, value), on_stored)
            self._read_at = self._now()


def _name(message: Message) -> str:
    name = message.param_id
    return (name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)).partition("\0")[0]


def _index(rows: tuple[ParameterId, ...], name: str) -> int | None:
    return next((index for index, row in enumerate(rows) if row.id == name), None)


def _whole(message: Message) -> int | None:
    """The byte that a PARAM_SET asks for, whichever way its program encodes whole numbers; None for none."""
    value = message.param_value
    if not math.isfinite(value):
        return None
    if message.param_type != mavlink.MAV_PARAM_TYPE_REAL32 and 0.0 < abs(value) < _TINY:
        (value,) = struct.unpack("<I", struct.pack("<f", value))
    return int(value) if value == int(value) and 0 <= value <= 255 else None


def _refuse(by: By, message: Message, error: int) -> None:
    index = getattr(message, "param_index", -1)
    name = _name(message).encode("ascii", "replace")[:16]
    by.send(mavlink.MAVLink_param_error_message(*by.program, name, index, error))

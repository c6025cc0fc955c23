"""The mission protocol: the list of the NaviCtrl, or a path of the daemon, read and replaced whole.

An upload is accepted once the daemon has written it and read it back; what a MikroKopter cannot do is refused with a
reason. A mission that was uploaded from here is sent back as it came, for as long as the board holds the list it
became. Fences and rally points are none of a MikroKopter's. Source: https://mavlink.io/en/services/mission.html
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, Final

from mkdaemon.client import Vehicle
from mkdaemon.errors import CommandRejectedError, ManoeuvreError, MkError
from mkdaemon.gateways.faults import Faults
from mkdaemon.gateways.mavlink.dialect import UINT16_UNKNOWN, Message, mavlink
from mkdaemon.gateways.mavlink.frames import degrees_e7
from mkdaemon.gateways.mavlink.missionitems import (
    HeldMission,
    Item,
    UnflyableError,
    addressed,
    autopilot_of,
    held_from,
    item_from,
    item_of,
    mission_of,
)
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.paths import FROM_THE_FIRST, PathMission, is_path
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.stations import By, Take
from mkdaemon.gateways.mavlink.texts import INFO, Notify, words_of
from mkdaemon.telemetry.mission import MissionEvent
from mkdaemon.telemetry.navi import ControlNavi, NaviStage
from mkdaemon.telemetry.refusals import Token
from mkdaemon.telemetry.state import Flight, Position
from mkdaemon.telemetry.vehicle import VehicleHealth

AGAIN: Final = 0.7
"""Time after which a missing item is requested again [s]."""
STORING: Final = 1.2
"""Period of requests for the last item while the board stores the list [s]: its sender keeps waiting."""
ATTEMPTS: Final = 5
"""Requests for one item."""
MOST_ITEMS: Final = 1000
"""Items of an upload; no NaviCtrl holds more than 254 points."""
_FLOWN: Final = frozenset({NaviStage.ROUTE, NaviStage.AT_POINT})
_RESULTS: Final[dict[str, int]] = {
    Token.POINT_NOT_EXPRESSIBLE: mavlink.MAV_MISSION_UNSUPPORTED,
    Token.TOO_MANY_POINTS: mavlink.MAV_MISSION_NO_SPACE,
    Token.PATH_REFUSED: mavlink.MAV_MISSION_INVALID,
}


@dataclass(slots=True)
class MissionUpload:
    """An upload under way.

    Attributes:
        by: whose it is.
        count: items that are to come.
        items: those that came.
        asked_at: when the next was last asked for [s].
        attempts: how often.
        is_old: whether its sender answers MISSION_REQUEST, and not MISSION_REQUEST_INT.
        storing: the procedure that stores them; None while they come.
    """

    by: By
    count: int
    asked_at: float
    items: list[Item] = field(default_factory=list)
    attempts: int = 0
    is_old: bool = False
    storing: asyncio.Task[None] | None = None


class MissionServer:
    """Answers the mission protocol.

    Attributes:
        takes: what answers a message, by its name.
    """

    def __init__(
        self,
        uav: Vehicle,
        picture: LinkPicture,
        notify: Notify,
        now: Callable[[], float],
        faults: Faults,
        path: PathMission,
    ) -> None:
        """Serve missions.

        Args:
            uav: the vehicle.
            picture: what is known of it.
            notify: tells a ground station why.
            now: the clock [s].
            faults: counts what an upload fails by.
            path: a mission in a local frame, which leaves the list of the NaviCtrl as it is.
        """
        self._uav, self._picture, self._notify, self._now, self._faults = uav, picture, notify, now, faults
        self._path = path
        self._held: HeldMission | None = None
        self._on_board: str | None = None
        self._upload: MissionUpload | None = None
        self._lock = asyncio.Lock()
        self._reached = 0
        self._answers: dict[str, Take] = {
            "MISSION_REQUEST_LIST": self._send_count,
            "MISSION_REQUEST_INT": self._send_item,
            "MISSION_REQUEST": self._send_item,
            "MISSION_COUNT": self._begin,
            "MISSION_ITEM_INT": self._take_item,
            "MISSION_ITEM": self._take_item,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_ACK": self._cancel,
            "MISSION_SET_CURRENT": lambda by, _: notify(by.station, FROM_THE_FIRST),
            "MISSION_WRITE_PARTIAL_LIST": self._refuse_part,
            "MISSION_REQUEST_PARTIAL_LIST": self._refuse_part,
        }
        self.takes: dict[str, Take] = dict.fromkeys(self._answers, self._take)

    def event_arrived(self, event: MissionEvent) -> None:
        """Take note of a changed list; its digest shows whether the change came from here."""
        self._on_board = event.digest or None
        if self._held is not None and event.action != "started" and self._held.digest != event.digest:
            self._held = None

    def _take(self, by: By, message: Message) -> Coroutine[Any, Any, None] | None:
        """Answer a message. There are no fences and rally points, and none can be stored."""
        name, kind = message.get_type(), getattr(message, "mission_type", 0)
        if kind in (mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_ALL):
            return self._answers[name](by, message)
        if name == "MISSION_REQUEST_LIST":
            by.send(mavlink.MAVLink_mission_count_message(*by.program, 0, kind))
        elif name in ("MISSION_COUNT", "MISSION_CLEAR_ALL"):
            is_nothing = name == "MISSION_CLEAR_ALL" or message.count == 0
            result = mavlink.MAV_MISSION_ACCEPTED if is_nothing else mavlink.MAV_MISSION_UNSUPPORTED
            by.send(mavlink.MAVLink_mission_ack_message(*by.program, result, kind))
        return None

    def _cancel(self, by: By, _: Message) -> None:
        """A sender gives its upload up: MISSION_ACK before the last item."""
        if self._upload is not None and self._upload.by == by and self._upload.storing is None:
            self._upload = None

    def _refuse_part(self, by: By, _: Message) -> None:
        self._notify(by.station, "the list is read and written whole only")
        self._acknowledge(by, mavlink.MAV_MISSION_UNSUPPORTED)

    def tick(self) -> None:
        """Ask again for what does not come, and end an upload that has stopped."""
        upload = self._upload
        if upload is None:
            return
        now = self._now()
        if upload.storing is not None:
            if upload.count and now - upload.asked_at >= STORING:  # an empty list has no item to ask for
                self._ask(upload, upload.count - 1)
            return
        if now - upload.asked_at < AGAIN:
            return
        if upload.attempts >= ATTEMPTS:
            self._upload = None
            self._acknowledge(upload.by, mavlink.MAV_MISSION_OPERATION_CANCELLED)
            return
        self._ask(upload, len(upload.items))

    def current(self) -> Message:
        """MISSION_CURRENT: where the daemon is on its path, or the NaviCtrl in its list."""
        if (on_path := self._path.current()) is not None:
            return on_path
        navi, flight, held = self._picture.get(ControlNavi), self._picture.get(Flight), self._held
        seq, state, mode = 0, mavlink.MISSION_STATE_UNKNOWN, 0
        total = UINT16_UNKNOWN if held is None or not held.items else max(len(held.items) - 1, 0)
        if held is not None and not held.items:
            state = mavlink.MISSION_STATE_NO_MISSION
        elif navi is not None and flight is not None:
            is_flown = navi.stage in _FLOWN
            mode = 1 if is_flown else 2
            seq = (held.seq_of(navi.waypoint) if held is not None and navi.waypoint else 0) or 0
            state = mavlink.MISSION_STATE_NOT_STARTED
            if navi.is_route_done:
                state = mavlink.MISSION_STATE_COMPLETE
            elif navi.waypoint:
                state = mavlink.MISSION_STATE_ACTIVE if is_flown else mavlink.MISSION_STATE_PAUSED
        return mavlink.MAVLink_mission_current_message(seq, total, state, mode)

    def reached(self) -> list[Message]:
        """MISSION_ITEM_REACHED, once for each point that was reached."""
        navi, held = self._picture.get(ControlNavi), self._held
        if self._path.held is not None:
            return self._path.reached()
        if navi is None or held is None or navi.stage is not NaviStage.AT_POINT:
            self._reached = 0
            return []
        seq = held.seq_of(navi.waypoint)
        if navi.waypoint == self._reached or seq is None:
            return []
        self._reached = navi.waypoint
        return [mavlink.MAVLink_mission_item_reached_message(seq)]

    async def _known(self) -> HeldMission:
        """The list, read where it is not known.

        Raises:
            MkError: it cannot be read.
        """
        async with self._lock:
            held = self._held
            if held is not None and self._on_board in (None, held.digest):
                return held
            health = self._picture.get(VehicleHealth)
            if health is not None and health.boards and "nc" not in health.boards:
                return HeldMission((), "", ())
            found = await self._uav.waypoints.read()
            self._held = held_from(found.points, found.digest)
            self._on_board = found.digest
            return self._held

    async def _send_count(self, by: By, _: Message) -> None:
        items = await self._items_for(by)
        if items is not None:
            by.send(mavlink.MAVLink_mission_count_message(*by.program, len(items), mavlink.MAV_MISSION_TYPE_MISSION))

    async def _send_item(self, by: By, message: Message) -> None:
        items = await self._items_for(by)
        if items is None:
            return
        if message.seq >= len(items):
            self._acknowledge(by, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        is_old = message.get_type() == "MISSION_REQUEST"
        by.send(addressed(items[message.seq], by, message.seq, is_old=is_old))

    async def _items_for(self, by: By) -> tuple[Item, ...] | None:
        """The items as a station numbers them; None if they cannot be read, which it is answered."""
        try:
            held = self._path.held or await self._known()
        except MkError as error:
            self._notify(by.station, f"the mission cannot be read: {words_of(error)}")
            self._acknowledge(by, mavlink.MAV_MISSION_ERROR)
            return None
        return (self._home(), *held.items) if by.station.numbering is Numbering.ARDUPILOT else held.items

    def _home(self) -> Item:
        """Item 0 as ArduPilot has it; zeros while home is not known."""
        here, x, y, z = self._picture.get(Position), 0, 0, 0.0
        if here is not None and here.home_latitude_deg is not None and here.home_longitude_deg is not None:
            x, y = degrees_e7(here.home_latitude_deg), degrees_e7(here.home_longitude_deg)
            z = self._picture.ground or 0.0
        return item_of(mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_FRAME_GLOBAL, (0.0, 0.0, 0.0, 0.0), (x, y, z))

    def _begin(self, by: By, message: Message) -> None:
        upload, count = self._upload, message.count
        if upload is not None and upload.by != by:
            self._notify(by.station, "another ground station is uploading a mission")
            self._acknowledge(by, mavlink.MAV_MISSION_DENIED)
        elif count > MOST_ITEMS:
            self._notify(by.station, f"{count} items: no NaviCtrl holds more than 254 points")
            self._acknowledge(by, mavlink.MAV_MISSION_NO_SPACE)
        elif upload is None or upload.storing is None:
            self._upload = upload = MissionUpload(by, count, self._now())
            if count == 0:
                self._store(upload)
            else:
                self._ask(upload, 0)

    def _ask(self, upload: MissionUpload, seq: int) -> None:
        upload.asked_at, upload.attempts = self._now(), upload.attempts + 1
        # DroneKit knows only the old request. Once a station answers one of the two kinds, it gets only that kind.
        is_old = upload.is_old if upload.items else upload.attempts % 2 == 0
        make = mavlink.MAVLink_mission_request_message if is_old else mavlink.MAVLink_mission_request_int_message
        upload.by.send(make(*upload.by.program, seq, 0))

    def _take_item(self, by: By, message: Message) -> None:
        upload = self._upload
        if upload is None or upload.by != by:
            self._acknowledge(by, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        if upload.storing is not None or message.seq < len(upload.items):  # sent twice
            return
        if message.seq > len(upload.items):
            if self._now() - upload.asked_at > AGAIN / 2:
                self._ask(upload, len(upload.items))
            return
        if not upload.items:
            upload.is_old = message.get_type() == "MISSION_ITEM" and upload.attempts % 2 == 0
        upload.items.append(item_from(message))
        upload.attempts = 0
        if len(upload.items) < upload.count:
            self._ask(upload, len(upload.items))
        else:
            self._store(upload)

    def _store(self, upload: MissionUpload) -> None:
        upload.asked_at = self._now()
        upload.storing = asyncio.create_task(self._store_now(upload), name="mission upload")

    async def _store_now(self, upload: MissionUpload) -> None:
        try:
            await self._replace(upload)
            result = int(mavlink.MAV_MISSION_ACCEPTED)
        except MkError as error:
            self._notify(upload.by.station, f"the mission is not stored: {words_of(error)}")
            result = _result_of(error)
        except Exception as error:  # noqa: BLE001  # a fault ends this upload
            self._faults.note("mission upload", error)
            result = int(mavlink.MAV_MISSION_ERROR)
        finally:
            self._upload = None
        self._acknowledge(upload.by, result)

    async def _replace(self, upload: MissionUpload) -> None:
        """Store the items.

        Raises:
            MkError: no MikroKopter can fly them, the daemon refuses, or it is not proven.
        """
        station = upload.by.station
        skipped = int(station.numbering is Numbering.ARDUPILOT)
        items = upload.items[skipped:]
        if not items:
            await self._empty()
            return
        if is_path(items):
            self._require_not_flown()
            await self._path.store(items, skipped, autopilot_of(station))
            return
        mission, notes = mission_of(items, self._picture.ground, skipped, autopilot_of(station))
        for note in notes:
            self._notify(station, note, INFO)
        self._require_not_flown()
        async with self._lock:
            stored = await self._uav.waypoints.upload(mission.points, in_flight=True, source="MAVLink")
            self._held = held_from(mission.points, stored.digest, items, autopilot_of(station))
            self._on_board, self._path.held = stored.digest, None

    def _require_not_flown(self) -> None:
        """A list that is flown is not replaced: the aircraft would fly home until the switch is turned away and back.

        Raises:
            ManoeuvreError: it is flown, or a path is.
        """
        if self._path.is_flown:
            raise ManoeuvreError("the path is being flown: hold or land first")
        navi = self._picture.get(ControlNavi)
        if navi is not None and navi.stage in _FLOWN:
            raise ManoeuvreError("the list is being flown: the pilot turns the GPS switch to hold or free first")

    async def _empty(self) -> None:
        """Drop the path; without one, clear the list of the NaviCtrl.

        Raises:
            MkError: it is flown, or the daemon refuses.
        """
        self._require_not_flown()
        if self._path.held is not None:
            self._path.held = None
            return
        async with self._lock:
            self._on_board = (await self._uav.waypoints.clear(in_flight=True)).digest
            self._held = HeldMission((), self._on_board, ())

    async def _clear(self, by: By, _: Message) -> None:
        try:
            await self._empty()
        except MkError as error:
            self._notify(by.station, f"the mission is not cleared: {words_of(error)}")
            self._acknowledge(by, mavlink.MAV_MISSION_DENIED)
            return
        self._acknowledge(by, mavlink.MAV_MISSION_ACCEPTED)

    @staticmethod
    def _acknowledge(by: By, result: int) -> None:
        by.send(mavlink.MAVLink_mission_ack_message(*by.program, result, mavlink.MAV_MISSION_TYPE_MISSION))


def _result_of(error: MkError) -> int:
    """The `MAV_MISSION_RESULT` of a refusal."""
    if isinstance(error, UnflyableError):
        return error.result
    if not isinstance(error, CommandRejectedError):
        return int(mavlink.MAV_MISSION_ERROR)
    return int(_RESULTS.get(error.token, mavlink.MAV_MISSION_DENIED))

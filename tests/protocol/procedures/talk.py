"""Boards at the level of messages, and a line that loses what the test says, to drive procedures without bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from mkdaemon.protocol.flags import PositionStatus
from mkdaemon.protocol.framing import padded_length
from mkdaemon.protocol.messages import (
    Settings,
    SettingsRequest,
    SettingsWritten,
    VersionFc210,
    VersionRequest,
    Waypoint024,
    WaypointCount,
    WaypointRequest,
    WaypointWritten,
    WriteSettings,
    WriteWaypoint024,
)
from mkdaemon.protocol.procedures.steps import Ask, Procedure, Progress, Step
from mkdaemon.protocol.wire import WireMessage

_Result = TypeVar("_Result")
Reply = WireMessage | None


def drive(
    procedure: Procedure[_Result], board: Callable[[WireMessage], Reply], heard: list[Step] | None = None
) -> _Result:
    """Run a procedure against a board that answers each request at once, or never."""
    answer: Reply = None
    while True:
        try:
            step = procedure.send(answer)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
        if heard is not None:
            heard.append(step)
        answer = None
        if isinstance(step, Ask):
            reply = board(step.message)
            answer = reply if reply is not None and step.accepts(reply) else None
        elif isinstance(step, Progress):
            assert 0 <= step.done <= step.total


def received(payload: bytes) -> bytes:
    """A payload as the line delivers it: padded."""
    return payload.ljust(padded_length(len(payload)), b"\0")


class NaviCtrl:
    """The waypoint list of a NaviCtrl 0.24, as its answers show it."""

    def __init__(self, limit: int = 31) -> None:
        self.limit = limit
        self.points: list[bytes] = []

    def __call__(self, request: WireMessage) -> Reply:
        if isinstance(request, WriteWaypoint024):
            return WaypointWritten(index=self._write(request))
        if isinstance(request, WaypointRequest):
            if request.index > len(self.points):
                return WaypointCount(count=len(self.points))
            raw = bytes((len(self.points), request.index)) + self.points[request.index - 1]
            return Waypoint024.decode(raw)
        return None

    def _write(self, point: WriteWaypoint024) -> int:
        if point.index == 0 and point.status == PositionStatus.INVALID:
            self.points.clear()
            return 0
        if not 0 < point.index <= min(self.limit, len(self.points) + 1):
            return 0
        self.points[point.index - 1 : point.index] = [point.encode()]
        return point.index


class FlightCtrl:
    """The parameter sets of a FlightCtrl, 2.12a where nothing else is said: reading loads, writing activates."""

    def __init__(self, active: int = 3, size: int = 144, revision: int = 106) -> None:
        self.revision, self.size = revision, size
        self.sets = {
            slot: bytes([revision, slot] + [(slot * 7 + n) & 0xFF for n in range(size - 2)]) for slot in range(1, 6)
        }
        self.release = (2, 12)
        self.active = active
        self.live = self.sets[active]
        self.motors_running = False
        self.rule: Callable[[bytes], bytes] = bytes

    def __call__(self, request: WireMessage) -> Reply:
        if isinstance(request, VersionRequest):
            return VersionFc210.decode(bytes((*self.release, 11, 0xBA, 0, 0, 0, 22, 103, 1)))
        if isinstance(request, SettingsRequest):
            index = self.active if request.index == 255 else request.index
            self.live = self.sets[index]
            return Settings.decode(received(bytes([index]) + self.live))
        if isinstance(request, WriteSettings):
            if self.motors_running or request.parameters[0] != self.revision:
                return SettingsWritten(index=0)
            self.sets[request.index] = self.live = self.rule(request.parameters[: self.size])
            self.active = request.index
            return SettingsWritten(index=request.index)
        return None


def losing(board: Callable[[WireMessage], Reply], fates: Iterator[str]) -> Callable[[WireMessage], Reply]:
    """A line to `board` where each exchange meets the next fate: ok, request (lost), reply (lost)."""

    def talk(request: WireMessage) -> Reply:
        fate = next(fates, "ok")
        if fate == "request":
            return None
        reply = board(request)
        return None if fate == "reply" else reply

    return talk

"""The daemon's own code at a NaviCtrl, genuine or simulated, in virtual time: link, procedures, lease and sticks.

What is wired on an aircraft is wired here: `Wiring` with its link, its requests and its flight core. Each step asks for
something as a client does, and says how it ended.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any, Final, Protocol

from lab.hil.forkedflight import CutCable
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.setpoint import StickSetpoint
from mksim.physics.hand_flight import HandFlight
from mksim.physics.world import World
from mksim.programs.virtualdaemon import VirtualDaemon
from mksim.programs.virtualports import Aircraft, Cable, LocalBus

PERIOD: Final = 0.02
STREAM: Final = 0.05
"""Between two setpoints of sticks [s]: half of what a NaviCtrl forwards."""
NEUTRAL, COMMANDS = 30, 80
"""Setpoints with sticks in the middle, with which control begins, and with another pitch each."""
ECHOES: Final = 40
SETTLING: Final = 3.0
"""Of telemetry, once the boards are known [s]."""
FLYING: Final = 14.0
"""From the pilot's start to a steady hover [s]."""
STATES: Final = ("state/gps", "state/flight", "state/battery", "state/pilot", "state/altitude", "state/attitude")


class NaviAtPort(Aircraft, Protocol):
    """Boards with a NaviCtrl's port at the end of the cable."""

    @property
    def world(self) -> World:
        """What flies."""


@dataclass(frozen=True, slots=True)
class Step:
    """What became of a step.

    Attributes:
        name: of it.
        ended: how, in words; equal on boards that behave alike.
        figure: a time [s] or a count, where it has one.
    """

    name: str
    ended: str
    figure: float | None = None


class DaemonAtNavi:
    """A daemon, one client, and the boards.

    Attributes:
        steps: what was done.
        sent: stick frames that were written.
    """

    def __init__(self, aircraft: NaviAtPort, held: Callable[[], tuple[int, int, int, int, bool]]) -> None:
        """Wire it up; needs a running loop.

        Args:
            aircraft: the boards; powered up already.
            held: external control as the FlightCtrl holds it: pitch, roll, yaw, throttle, whether it is valid.
        """
        self.loop = asyncio.get_running_loop()
        self.aircraft, self._held = aircraft, held
        self.bus = LocalBus()
        self.steps: list[Step] = []
        self.holdings: list[tuple[float, tuple[int, int, int, int, bool]]] = []
        self._streamed_at = 0.0
        self._line = CutCable(aircraft)
        self.daemon = VirtualDaemon(self.bus, Cable(self._line, self._moved).open)
        self.wiring = self.daemon.wiring

    def _moved(self, now: float) -> None:
        if not self.holdings or self.holdings[-1][1] != self._held():
            self.holdings.append((now, self._held()))

    async def run(self) -> list[Step]:
        """Do every step, and stop the daemon."""
        self.daemon.start()
        try:
            await self._meet()
            await self._ask()
            await self._store()
            await self._pass_on()
            await self._control()
        finally:
            await self.daemon.stop()
        return self.steps

    def _note(self, name: str, ended: str, figure: float | None = None) -> None:
        self.steps.append(Step(name, ended, figure))

    async def _until(self, claim: Callable[[], bool], within: float) -> float | None:
        began = self.loop.time()
        while not claim():
            if self.loop.time() - began > within:
                return None
            await asyncio.sleep(PERIOD)
        return self.loop.time() - began

    async def _command(self, suffix: str, **fields: Any) -> tuple[CommandResult, float]:
        began = self.loop.time()
        result = await self.bus.ask(suffix, **fields)
        return result, self.loop.time() - began

    async def _meet(self) -> None:
        """Open the line, and learn who is there."""
        link = self.wiring.link
        took = await self._until(lambda: link.is_up, 20.0)
        self._note("link up", "never" if took is None else "yes", took)
        took = await self._until(lambda: link.dialect.extern_control is not None, 20.0)
        control = link.dialect.extern_control
        self._note("boards known", "never" if control is None else control.__name__, took)
        await asyncio.sleep(SETTLING)
        missing = [key for key in STATES if key not in self.bus.values]
        self._note("telemetry", "all of it" if not missing else f"missing: {', '.join(missing)}")
        flight = self.bus.values.get("state/flight")
        error = "" if flight is None else str(getattr(flight, "error", ""))
        self._note("error of the NaviCtrl", error or "none")

    async def _ask(self) -> None:
        """Requests that the NaviCtrl answers itself."""
        for name in ("version_request", "error_text_request"):
            result, took = await self._command(f"cmd/nc/{name}")
            self._note(name, self._ended(result), took)
        result, took = await self._command("cmd/nc/label_request", index=13)
        self._note("label_request", self._ended(result), took)
        times = []
        for pattern in range(ECHOES):
            result, took = await self._command("cmd/nc/echo_request", pattern=pattern)
            if result.reply is not None and result.reply.get("pattern") == pattern:
                times.append(took)
            await asyncio.sleep(PERIOD)
        self._note("link tests answered", f"{len(times)} of {ECHOES}", median(times) if times else None)

    @staticmethod
    def _ended(result: CommandResult) -> str:
        return f"{result.status.value}{f' {result.token}' if result.token else ''}"

    async def _store(self) -> None:
        """The waypoint list: upload, read back, compare, clear."""
        points = self._points()
        result, took = await self._command("do/waypoints_upload", points=points)
        self._note("waypoints_upload", f"{self._ended(result)}, {self._count(result)} stored", took)
        result, took = await self._command("do/waypoints_verify", points=points)
        self._note("waypoints_verify", self._ended(result), took)
        result, took = await self._command("do/waypoints_read")
        self._note("waypoints_read", f"{self._ended(result)}, {self._count(result)} points", took)
        result, took = await self._command("do/waypoints_clear")
        self._note("waypoints_clear", f"{self._ended(result)}, {self._count(result)} stored", took)

    @staticmethod
    def _count(result: CommandResult) -> object:
        reply = result.reply or {}
        return reply.get("count", len(reply.get("points", ())))

    def _points(self) -> list[dict[str, Any]]:
        world = self.aircraft.world
        fix = world.sensors.gps
        place = {"latitude_deg": fix.latitude_1e7 / 1e7, "longitude_deg": fix.longitude_1e7 / 1e7, "altitude": 10.0}
        return [place | {"hold": hold} for hold in (1, 2, 3)] + [place | {"kind": "poi"}]

    async def _pass_on(self) -> None:
        """Requests to boards behind it: the line is passed through to them and back."""
        for name, suffix in (("FlightCtrl", "cmd/fc/version_request"), ("compass", "cmd/mag/version_request")):
            result, took = await self._command(suffix)
            self._note(f"passed to the {name}", self._ended(result), took)
        result, took = await self._command("do/mixer_read")
        self._note("mixer of the FlightCtrl", self._ended(result), took)
        result, took = await self._command("cmd/nc/version_request")
        self._note("NaviCtrl after it", self._ended(result), took)

    async def _control(self) -> None:
        """External control, forwarded to the FlightCtrl, and its dead-man."""
        await self._hover()
        facts = self.wiring.facts
        self._note("motors known to run", str(facts.motors_running(self.loop.time())))
        try:
            await self.bus.take_lease("lab")
        except (AssertionError, CommandRejectedError) as refusal:
            self._note("lease", f"refused: {refusal}")
            return
        self._note("lease", "granted")
        await self._stream(NEUTRAL, lambda count: 0.0)
        began = self.loop.time()
        await self._stream(COMMANDS, lambda count: 5.0 if count % 2 else -5.0)
        held = [(at, now) for at, now in self.holdings if at > began and now[4]]
        self._note("sticks reach the FlightCtrl", "yes" if held else "no", held[0][0] - began if held else None)
        self._note("commands it held", "most" if len(held) > COMMANDS / 2 else "some" if held else "none", len(held))
        await self._dead_man()

    async def _hover(self) -> None:
        """The pilot takes off and hovers by hand."""
        self.aircraft.world.pilot.program = HandFlight()
        await asyncio.sleep(FLYING)

    async def _stream(self, count: int, pitch: Callable[[int], float]) -> None:
        """Stream setpoints of sticks."""
        for number in range(count):
            fields = {"pitch": pitch(number), "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
            self.bus.deliver(StickSetpoint, self.loop.time(), *self.bus.sign_next(StickSetpoint, fields))
            self._streamed_at = self.loop.time()
            await asyncio.sleep(STREAM)

    async def _dead_man(self) -> None:
        """The cable is cut while sticks are held: how long the FlightCtrl goes on with them."""
        self._line.is_cut = self._line.is_deaf = True
        gone = await self._until(lambda: not self._held()[4], 8.0)
        self._note("dead-man behind it", "never" if gone is None else "yes", None if gone is None else gone)

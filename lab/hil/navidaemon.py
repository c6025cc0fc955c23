"""The daemon's own code at a NaviCtrl, genuine or simulated, in virtual time: link, procedures, lease and sticks.

Each step asks for something as a client does, and says how it ended.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from statistics import median
from typing import Any, Final

from lab.campaign import Row
from lab.hil.chip import Held
from lab.hil.client import Client
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.setpoint import StickSetpoint
from mksim.physics.hand_flight import HandFlight
from mksim.programs.rehearsal import FlyingAircraft

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
LONGEST: Final = 20.0
"""Longest wait for the boards [s]."""
STATES: Final = ("state/gps", "state/flight", "state/battery", "state/pilot", "state/altitude", "state/attitude")
BEHIND: Final = {
    "passed to the FlightCtrl": "cmd/fc/version_request",
    "passed to the compass": "cmd/mag/version_request",
    "mixer of the FlightCtrl": "do/mixer_read",
    "NaviCtrl after it": "cmd/nc/version_request",
}
"""Requests to boards behind it: the line is passed through to them and back."""


class DaemonAtNavi(Client):
    """A daemon, one client, and the boards.

    Attributes:
        steps: what was done: `what`, how it `ended` in words that are equal on boards that behave alike, and a
            `figure`, a time [s] or a count, where it has one.
    """

    def __init__(self, aircraft: FlyingAircraft, held: Callable[[], Held]) -> None:
        """Wire it up to boards that are powered up; needs a running loop."""
        super().__init__(aircraft, held)
        self.world = aircraft.world
        self.steps: list[Row] = []
        self._streamed_at = 0.0

    async def run(self) -> list[Row]:
        """Do every step, and stop the daemon."""
        self.daemon.start()
        try:
            await self._do_steps()
        finally:
            await self.daemon.stop()
        return self.steps

    async def _do_steps(self) -> None:
        await self._meet()
        await self._ask()
        await self._store()
        await self._pass_on()
        await self._control()

    def _note(self, what: str, ended: str, figure: float | None = None) -> None:
        self.steps.append({"what": what, "ended": ended, "figure": figure})

    async def _wait(self, what: str, claim: Callable[[], bool], within: float, since: float | None = None) -> None:
        """Wait for a claim, and note how long it took [s], from now on or since a time."""
        began = self.loop.time() if since is None else since
        took = await self.until(claim, within)
        self._note(what, "never" if took is None else "yes", None if took is None else self.loop.time() - began)

    async def _command(self, what: str, suffix: str, counted: str = "", **fields: Any) -> None:
        began = self.loop.time()
        result = await self.bus.ask(suffix, **fields)
        reply = result.reply or {}
        count = f", {reply.get('count', len(reply.get('points', ())))} {counted}" if counted else ""
        self._note(what, f"{_ended(result)}{count}", self.loop.time() - began)

    async def _meet(self) -> None:
        """Open the line, and learn who is there."""
        await self._wait("link up", lambda: self.wiring.link.is_up, LONGEST)
        await self._wait("boards known", lambda: self.is_line_known, LONGEST)
        control = self.wiring.link.dialect.extern_control
        self._note("stick frames", "none" if control is None else control.__name__)
        await asyncio.sleep(SETTLING)
        missing = [key for key in STATES if key not in self.bus.values]
        self._note("telemetry", "all of it" if not missing else f"missing: {', '.join(missing)}")
        error = getattr(self.bus.values.get("state/flight"), "error", None)
        self._note("error of the NaviCtrl", str(error or "none"))

    async def _ask(self) -> None:
        """Requests that the NaviCtrl answers itself."""
        await self._command("version_request", "cmd/nc/version_request")
        await self._command("error_text_request", "cmd/nc/error_text_request")
        await self._command("label_request", "cmd/nc/label_request", index=13)
        times = []
        for pattern in range(ECHOES):
            began = self.loop.time()
            result = await self.bus.ask("cmd/nc/echo_request", pattern=pattern)
            if result.reply is not None and result.reply.get("pattern") == pattern:
                times.append(self.loop.time() - began)
            await asyncio.sleep(PERIOD)
        self._note("link tests answered", f"{len(times)} of {ECHOES}", median(times) if times else None)

    async def _store(self) -> None:
        """The waypoint list: upload, read back, compare, clear."""
        fix = self.world.sensors.gps
        place = {"latitude_deg": fix.latitude_1e7 / 1e7, "longitude_deg": fix.longitude_1e7 / 1e7, "altitude": 10.0}
        points = [place | {"hold": hold} for hold in (1, 2, 3)] + [place | {"kind": "poi"}]
        await self._command("waypoints_upload", "do/waypoints_upload", "stored", points=points)
        await self._command("waypoints_verify", "do/waypoints_verify", points=points)
        await self._command("waypoints_read", "do/waypoints_read", "points")
        await self._command("waypoints_clear", "do/waypoints_clear", "stored")

    async def _pass_on(self) -> None:
        for what, suffix in BEHIND.items():
            await self._command(what, suffix)

    async def _control(self) -> None:
        """External control, forwarded to the FlightCtrl, and its dead-man."""
        await self._hover()
        self._note("motors known to run", str(self.wiring.facts.motors_running(self.loop.time())))
        try:
            await self.bus.take_lease("lab")
        except (AssertionError, CommandRejectedError) as refusal:
            self._note("lease", f"refused: {refusal}")
            return
        self._note("lease", "granted")
        await self._stream(NEUTRAL, 0.0)
        began = self.loop.time()
        await self._stream(COMMANDS, -5.0, 5.0)
        held = [at for at, now in self.held if at > began and now[4]]
        self._note("sticks reach the FlightCtrl", "yes" if held else "no", held[0] - began if held else None)
        self._note("commands it held", "most" if len(held) > COMMANDS / 2 else "some" if held else "none", len(held))
        await self._dead_man()

    async def _hover(self) -> None:
        """The pilot takes off and hovers by hand."""
        self.world.pilot.program = HandFlight()
        await asyncio.sleep(FLYING)

    async def _stream(self, count: int, *pitches: float) -> None:
        """Stream setpoints of sticks, with these pitches in turn."""
        for number in range(count):
            fields = {"pitch": pitches[number % len(pitches)], "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
            self.bus.deliver(StickSetpoint, self.loop.time(), *self.bus.sign_next(StickSetpoint, fields))
            self._streamed_at = self.loop.time()
            await asyncio.sleep(STREAM)

    async def _dead_man(self) -> None:
        """The cable is cut while sticks are held: how long the FlightCtrl goes on with them."""
        self.cable.is_cut = self.cable.is_deaf = True
        await self._wait("dead-man behind it", lambda: not self._held()[4], 8.0)


def _ended(result: CommandResult) -> str:
    return f"{result.status.value}{f' {result.token}' if result.token else ''}"

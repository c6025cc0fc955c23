"""A flight of genuine firmware by a whole daemon with a guard, judged by what the firmware's memory holds."""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from lab.control.corerig import pose_of
from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.flights import Setting, config_of
from lab.hil.world import GenuineWorld
from lab.rigs.virtualguard import VirtualGuard
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.events import PoseSeen
from mkdaemon.telemetry.control import ControlStatus, Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, Setpoint, SetpointFrame, TakeOffSetpoint
from mksim.config import WindClass
from mksim.physics.hand_flight import HandFlight
from mksim.programs.virtualdaemon import VirtualDaemon
from mksim.programs.virtualports import Aircraft, Cable, LocalBus

CLIENT: Final = "lab"
HEIGHT: Final = 1.5
IMAGES: Final = 0.05
"""Between two poses [s]."""
IMAGE_AGE: Final = 0.08
"""Of a pose when it arrives [s]."""
NOISE: Final = 0.006
"""Of a pose, each axis [m]."""
STREAM: Final = 0.02
"""Between two setpoints [s]."""
LONGEST: Final = 40.0
"""Longest wait for anything [s]."""
Held = tuple[int, int, int, int, bool]


class CutCable:
    """The aircraft behind a cable whose daemon may fall silent."""

    def __init__(self, aircraft: Aircraft) -> None:
        self.aircraft, self.now = aircraft, aircraft.now
        self.is_cut = self.is_deaf = False

    def write(self, data: bytes, at: float) -> None:
        """Bytes of the daemon."""
        if not self.is_cut:
            self.aircraft.write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run on."""
        said, self.now = self.aircraft.advance(to), to
        return [] if self.is_deaf else said


class Flight:
    """A client that holds over the target, its daemon, guard, and the aircraft.

    Attributes:
        held: what the firmware held from a time on [s].
        phases: of authority, each with its first moment [s].
        status: newest of the daemon.
        is_streaming: the client streams.
        is_seeing: poses come.
    """

    def __init__(self, firmware: str, seed: int) -> None:
        loop = self.loop = asyncio.get_running_loop()
        setting = Setting(firmware, seed)
        self.aircraft = GenuineAircraft(built(firmware), config_of(setting), voltage=setting.voltage)
        self.world, self.cable = self.aircraft.world, CutCable(self.aircraft)
        self.bus, self._rng = LocalBus(), random.Random(f"{seed} poses")
        self.held: list[tuple[float, Held]] = []
        self.phases: list[tuple[float, Phase]] = []
        self.status: ControlStatus | None = None
        self.is_streaming = self.is_seeing = True
        self.seen_at = self.streamed_at = 0.0
        self.guard = VirtualGuard(lambda data: self.aircraft.write(data, max(loop.time(), self.aircraft.now)))
        self.bus.followers.append(self._hear)
        self.daemon = VirtualDaemon(self.bus, Cable(self.cable, self._moved).open, guard=self.guard)
        self.wiring = self.daemon.wiring
        self.wanted: tuple[type[Setpoint], dict[str, Any]] = (TakeOffSetpoint, {"height": HEIGHT})

    def _hear(self, suffix: str, value: object) -> None:
        if isinstance(value, ControlStatus):
            self.status = value
            if not self.phases or self.phases[-1][1] is not value.phase:
                self.phases.append((self.loop.time(), value.phase))

    def _moved(self, now: float) -> None:
        if not self.held or self.held[-1][1] != self.world.held:
            self.held.append((now, self.world.held))

    async def begin(self) -> None:
        """From the pilot's start of the motors to a hold."""
        self.guard.port_opened(0)
        self.daemon.start()
        self._jobs = [asyncio.create_task(self._see())]
        await self.until(self._is_ready)
        await self.bus.take_lease(CLIENT)
        self._jobs.append(asyncio.create_task(self._stream()))
        if await self.until(lambda: self.status is not None and self.status.is_done) is None:
            raise TimeoutError(f"no hold: {self.status}")
        self.wanted = (PositionSetpoint, {"position": (0.0, 0.0, HEIGHT), "frame": SetpointFrame.PAD})
        self.world.change_wind(WindClass.LIGHT)
        await asyncio.sleep(4.0)

    def _is_ready(self) -> bool:
        """Motors run, the pilot's throttle is still at its lowest, and the boards are known."""
        link, runs = self.wiring.link, self.wiring.facts.motors_running(self.loop.time())
        return bool(link.is_up and link.dialect.extern_control is not None and runs)

    async def _stream(self) -> None:
        while True:
            if self.is_streaming:
                kind, fields = self.wanted
                self.streamed_at = self.loop.time()
                self.bus.deliver(kind, self.streamed_at, *self.bus.sign_next(kind, fields))
            await asyncio.sleep(STREAM)

    async def _see(self) -> None:
        while True:
            truth, at = self.world.truth, self.loop.time()
            noise = np.array([self._rng.gauss(0.0, NOISE) for _ in range(3)])
            rotation = truth.enu_from_flu
            if self.is_seeing and truth.position_enu[2] > 0.25:
                self.seen_at = at
                place = -rotation.T @ (truth.position_enu + noise)
                view = TargetView(at, place, rotation, np.diag([NOISE**2] * 3 + [0.02**2] * 3), "down")
                self.loop.call_later(IMAGE_AGE, self._pose, view)
            await asyncio.sleep(IMAGES)

    def _pose(self, view: TargetView) -> None:
        self.wiring.core.feed(PoseSeen(pose_of(view)), self.loop.time())

    async def until(self, claim: Callable[[], bool], within: float = LONGEST) -> float | None:
        """Wait for a claim; how long that took [s], None where it never held."""
        began = self.loop.time()
        while not claim():
            if self.loop.time() - began > within:
                return None
            await asyncio.sleep(0.004)
        return self.loop.time() - began

    # -- judged by the firmware's memory --------------------------------------------------------------------------

    def level_after(self, since: float) -> float:
        """Time from a moment on to when the firmware holds no tilt any more [s]; infinite for never."""
        tilted = [k for k, (_, held) in enumerate(self.held) if held[4] and any(held[:3])]
        if not tilted:
            return 0.0
        after = tilted[-1] + 1
        return max(0.0, self.held[after][0] - since) if after < len(self.held) else math.inf

    def released_after(self, since: float) -> float:
        """Time from a moment on to when the firmware holds no valid control any more [s]; infinite for never."""
        valid = [k for k, (_, held) in enumerate(self.held) if held[4]]
        after = valid[-1] + 1
        return max(0.0, self.held[after][0] - since) if after < len(self.held) else math.inf

    def phase_after(self, phase: Phase, since: float) -> float:
        """Time from a moment on to a phase [s]; infinite for never."""
        return next((at - since for at, found in self.phases if found is phase and at >= since), math.inf)


class SteadyHand(HandFlight):
    """A pilot who leans against the wind: he aims as far beyond his place as he is off it."""

    def __init__(self, world: GenuineWorld) -> None:
        """Begin where the aircraft is."""
        super().__init__(height=HEIGHT, flying=True)
        self._world = world
        self._place = world.truth.position_enu[:2].copy()

    def path(self, t: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where he aims, from his place [m], and how fast that moves [m/s]."""
        del t
        east, north = self._place - self._world.truth.position_enu[:2]
        return (float(east), float(north)), (0.0, 0.0)

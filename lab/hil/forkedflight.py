"""A flight of genuine firmware by a whole daemon with a guard, judged by what the firmware's memory holds."""

from __future__ import annotations

import asyncio
import math
import random
from typing import Any, Final

import numpy as np

from lab.control.corerig import pose_of
from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.client import Client
from lab.hil.flights import Setting, config_of
from lab.hil.world import GenuineWorld
from lab.rigs.virtualguard import VirtualGuard
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.events import PoseSeen
from mkdaemon.telemetry.control import ControlStatus, Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, Setpoint, SetpointFrame, TakeOffSetpoint
from mksim.config import WindClass
from mksim.physics.hand_flight import HandFlight

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


class Flight(Client):
    """A client that holds over the target, its daemon, guard, and the aircraft.

    Attributes:
        phases: of authority, each with its first moment [s].
        status: newest of the daemon.
        is_streaming: the client streams.
        is_seeing: poses come.
    """

    def __init__(self, firmware: str, seed: int) -> None:
        setting = Setting(firmware, seed)
        aircraft = GenuineAircraft(built(firmware), config_of(setting), voltage=setting.voltage)
        now = asyncio.get_running_loop().time
        self.guard = VirtualGuard(lambda data: aircraft.write(data, max(now(), aircraft.now)))
        super().__init__(aircraft, lambda: aircraft.world.held, self.guard)
        self.world, self._rng = aircraft.world, random.Random(f"{seed} poses")
        self.phases: list[tuple[float, Phase]] = []
        self.status: ControlStatus | None = None
        self.is_streaming = self.is_seeing = True
        self.seen_at = self.streamed_at = 0.0
        self.bus.followers.append(self._value_published)
        self.wanted: tuple[type[Setpoint], dict[str, Any]] = (TakeOffSetpoint, {"height": HEIGHT})

    def _value_published(self, suffix: str, value: object) -> None:
        if isinstance(value, ControlStatus):
            self.status = value
            if not self.phases or self.phases[-1][1] is not value.phase:
                self.phases.append((self.loop.time(), value.phase))

    async def begin(self) -> None:
        """From the pilot's start of the motors to a hold."""
        self.guard.port_opened(0)
        self.daemon.start()
        self._jobs = [asyncio.create_task(self._see())]
        # the pilot's throttle is still at its lowest then
        await self.until(
            lambda: self.is_line_known and bool(self.wiring.facts.motors_running(self.loop.time())), LONGEST
        )
        await self.bus.take_lease(CLIENT)
        self._jobs.append(asyncio.create_task(self._stream()))
        if await self.until(lambda: self.status is not None and self.status.is_done, LONGEST) is None:
            raise TimeoutError(f"no hold: {self.status}")
        self.wanted = (PositionSetpoint, {"position": (0.0, 0.0, HEIGHT), "frame": SetpointFrame.PAD})
        self.world.change_wind(WindClass.LIGHT)
        await asyncio.sleep(4.0)

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

    # -- judged by the firmware's memory --------------------------------------------------------------------------

    def level_after(self, since: float) -> float:
        """Time from a moment on to when the firmware holds no tilt any more [s]; infinite for never."""
        return self._ended([held[4] and any(held[:3]) for _, held in self.held], since)

    def released_after(self, since: float) -> float:
        """Time from a moment on to when the firmware holds no valid control any more [s]; infinite for never."""
        return self._ended([held[4] for _, held in self.held], since)

    def _ended(self, claims: list[bool], since: float) -> float:
        after = max((k for k, claim in enumerate(claims) if claim), default=-1) + 1
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

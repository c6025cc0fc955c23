"""A flight of simulated boards in virtual time to which one thing happens, and what leaves on the wire then."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any, Final, cast

import numpy as np

from lab.control.corerig import pose_of
from lab.rigs.boardport import BoardPort
from lab.rigs.cockpit import Cockpit
from lab.rigs.grounded import GroundedAircraft
from lab.rigs.virtualguard import VirtualGuard
from mkdaemon.bus.codec import encode_map
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.events import PoseSeen
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import Setpoint, StickSetpoint
from mkdaemon.telemetry.signature import sign
from mkdaemon.telemetry.vision import VisionPose

LOOK: Final = 0.004
"""Between two looks whether something has happened [s]."""
STREAM: Final = 0.02
"""Time between two setpoints [s]."""
IMAGES: Final = 1 / 30
"""Time between two poses [s]."""
WAIT: Final = 12.0
"""Longest wait for anything [s]."""
CLIENT: Final = "lab"


class Client:
    """Streams setpoints of a kind, and poses of a target beside which the aircraft stands still.

    Attributes:
        last: when the last one was put [s].
        seen: when the last pose was taken [s].
    """

    def __init__(self, flown: Cockpit) -> None:
        self._flown = flown
        self._sequence = 0
        self.setpoint: tuple[type[Setpoint], dict[str, Any]] = (StickSetpoint, STILL)
        self.last = self.seen = math.nan
        self.is_streaming = self.is_seeing = True

    async def stream(self) -> None:
        """Put setpoints for ever."""
        loop, flown = asyncio.get_running_loop(), self._flown
        while True:
            if self.is_streaming:
                self._sequence += 1
                kind, fields = self.setpoint
                payload = encode_map({"epoch": flown.epoch, "sequence": self._sequence, "ttl": 0.3, **fields})
                proof = sign(flown.secret, kind.suffix, payload)
                flown.bus.deliver(kind, loop.time(), payload, proof)
                self.last = loop.time()
            await asyncio.sleep(STREAM)

    async def see(self) -> None:
        """Take poses for ever."""
        loop = asyncio.get_running_loop()
        while True:
            if self.is_seeing:
                self.seen = loop.time()
                self._flown.core.feed(PoseSeen(_pose(loop.time())), loop.time())
            await asyncio.sleep(IMAGES)


STILL: Final = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": -10.0}
LEANING: Final = {"pitch": 30.0, "roll": -30.0, "yaw": 0.0, "throttle": -10.0}
HERE: Final = {"position": (0.0, 0.0, 2.0), "frame": "pad"}
ASIDE: Final = {"position": (0.5, 0.0, 2.0), "frame": "pad"}


def _pose(at: float) -> VisionPose:
    """Two metres above the target, at rest."""
    return pose_of(TargetView(at, np.array([0.0, 0.0, -2.0]), np.eye(3), 1e-4 * np.eye(6)))


class Scene:
    """One flight to which one thing happens.

    Attributes:
        bench: what the boards are mounted on, with the pilot's transmitter.
        said: the latest value published under each key.
        before: a stick before it was moved.
    """

    before = 0.0

    def __init__(self, flown: Cockpit, client: Client, guard: VirtualGuard) -> None:
        self.flown, self.client, self.guard = flown, client, guard
        self.said = flown.bus.values
        self.loop = asyncio.get_running_loop()
        self.bench = cast("GroundedAircraft", flown.aircraft.world)

    @property
    def port(self) -> BoardPort:
        """The near end of the cable, where faults are injected."""
        assert self.flown.socket.port is not None
        return self.flown.socket.port

    async def until(self, claim: Callable[[], bool]) -> float:
        """Wait for a claim; returns when it began to hold [s], infinity where it never did."""
        waited = await self.flown.until(claim, within=WAIT, step=LOOK)
        return math.inf if waited is None else self.loop.time()

    async def lean(self) -> None:
        """Fly by sticks, tilted; no camera looks at a target then."""
        self.client.is_seeing = False
        await self.until(lambda: self.flown.flight.phase is Phase.FLYING)
        self.client.setpoint = (StickSetpoint, LEANING)
        await self.until(lambda: self.flown.aircraft.held[-1:] != [] and not self.flown.aircraft.held[-1].is_neutral)
        await asyncio.sleep(0.3)

    async def start_motors(self) -> None:
        """The pilot starts the motors, throttle at its lowest."""
        pilot, core = self.bench.pilot, self.flown.aircraft.flight.core
        pilot.pitch, pilot.roll, pilot.yaw, pilot.gas = -127, 127, -127, -127
        await self.until(lambda: core.running)
        pilot.pitch = pilot.roll = pilot.yaw = 0
        self.bench.sensors.motor_setpoints = [30] * 4 + [0] * 8  # the bench has no motors of its own

    async def release_after(self, since: float) -> float:
        """Time from a moment to the first frame of a release [s]."""
        await self.until(lambda: self._of(Purpose.RELEASE, since) != [])
        return min(self._of(Purpose.RELEASE, since), default=math.inf) - since

    async def level_after(self, since: float) -> float:
        """Time from a moment to the first stick frame from which on none has a tilt, until the release [s]."""
        await self.release_after(since)
        return self.level_since(since) - since

    def sticks_since(self, since: float) -> int:
        """How many stick frames of a setpoint left after a moment."""
        return len(self._of(Purpose.SETPOINT, since))

    def level_since(self, since: float) -> float:
        """When the first stick frame left after which none has had a tilt, of those after a moment [s]."""
        tilted = self._of(Purpose.SETPOINT, since, is_level=False)
        return min(self._of(Purpose.SETPOINT, max(tilted, default=since), is_level=True), default=math.inf)

    def _of(self, purpose: Purpose, since: float, *, is_level: bool | None = None) -> list[float]:
        """Times of the frames of a purpose after a moment, all of them or those with or without tilt [s]."""
        found = []
        for sent in reversed(self.flown.sink.tx):
            if sent.at <= since:
                break
            level = not any(getattr(sent.message, axis, 0) for axis in ("pitch", "roll", "yaw"))
            if sent.purpose is purpose and is_level in (None, level):
                found.append(sent.at)
        return found

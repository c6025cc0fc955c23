"""The flight of the demonstration: take-off, hold, a step of 1 m, the target starts to move, landing on it.

Everything between the setpoints and the bytes, and between the images and the estimate, is the daemon's own: control
loop, flight core, link with its release, tracker. Left out are Zenoh, the guard and the wall clock.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final

from pydantic import BaseModel

from mkdaemon.bus.codec import encode
from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.link import LinkConfig
from mkdaemon.control.events import Feed
from mkdaemon.daemon.deck import Deck
from mkdaemon.daemon.flight import FlightControl
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.telemetry.command import LeaseRequest
from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlStatus, LeaseGrant
from mkdaemon.telemetry.setpoint import (
    HoldSetpoint,
    LandSetpoint,
    PositionSetpoint,
    Setpoint,
    SetpointFrame,
    TakeOffSetpoint,
)
from mkdaemon.telemetry.signature import sign
from mksim.programs.rehearsal.cable import Cable
from mksim.programs.rehearsal.eyes import RehearsedEyes
from mksim.programs.rehearsal.record import Moment, Rehearsed
from mksim.programs.rehearsal.scenery import PAD_STARTS, simulated_aircraft
from mksim.scene.camera import SceneCamera, landing_world
from mksim.simulation import Simulation

HEIGHT: Final = 2.0
"""Flown above the target [m]."""
PERIOD: Final = 0.02
"""Of setpoints [s]."""
KEPT: Final = 0.05
"""Of moments in the record [s]."""
OLD: Final = 0.5
"""Errors and estimates older than this are not shown [s]: nothing is flown by them."""
READY: Final = 30.0
"""Longest wait for the boards to be known and the motors to run [s]."""
LONGEST: Final = 40.0
"""Longest part of the flight [s]."""
Watcher = Callable[[Moment, ControlStatus | None], None]
"""Sees every moment of the record, and the latest status."""


class Rehearsal:
    """One flight in virtual time.

    Attributes:
        record: what happened.
    """

    def __init__(self, *, seed: int, wind: str, fps: float, watcher: Watcher) -> None:
        """Set everything up; needs a running loop.

        Args:
            seed: of everything random.
            wind: none, indoor, light or moderate.
            fps: images a second.
            watcher: sees the flight.
        """
        loop = asyncio.get_running_loop()
        config = simulated_aircraft(seed, wind, fps)
        world = landing_world(config)
        assert world is not None
        self.record = Rehearsed()
        self._world, self._watcher, self._loop = world, watcher, loop
        self._scene = SceneCamera(config.scene, seed)
        clock = Clock(monotonic=loop.time, wall=lambda: 1.7e9 + loop.time(), synchronised=lambda: True)
        eyes: list[RehearsedEyes] = []

        def make_eyes(feed: Feed) -> RehearsedEyes:
            eyes.append(RehearsedEyes(self._scene, world, feed, clock, seed))
            return eyes[0]

        deck = Deck(ControlConfig(), self, clock, first_epoch=1, make_eyes=make_eyes)
        (self._eyes,), self._facts = eyes, deck.core.vehicle
        cable = Cable(Simulation(config, world), self._moved)
        self._link = Link(
            LinkConfig(port="simulated"),
            deck.sink,
            opener=cable.open,
            clock=clock,
            motors_running=self._facts.motors_running,
        )
        self._flight = FlightControl(deck, self._link, clock=clock)
        self._status: ControlStatus | None = None
        self._error: ControlError | None = None
        self._estimate: ControlEstimate | None = None
        self._part = ""
        self._lease: LeaseGrant | None = None
        self._sequence = 0
        self._kept_at = 0.0

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Take what the daemon would put on the bus; see `Outlet`."""
        del schema, suffix
        match value:
            case ControlStatus():
                self._status = value
            case ControlError():
                self._error = value
            case ControlEstimate():
                self._estimate = value
            case _:
                pass

    async def fly(self) -> Rehearsed:
        """Fly from the pilot's start of the motors to motors that stand still; the record."""
        jobs = [
            asyncio.create_task(self._link.run(discover), name="link"),
            asyncio.create_task(self._flight.run(), name="control"),
            asyncio.create_task(self._eyes.run(), name="eyes"),
        ]
        try:
            self._begin("start")
            if await self._wait(self._is_ready, READY):
                await self._take_lease()
                await self._fly_parts()
                self._begin("after")
                await self._wait(lambda: self._facts.motors_running(self._loop.time()) is False, 10.0)
            self.record.motors_stand = self._facts.motors_running(self._loop.time()) is False
        finally:
            for job in reversed(jobs):
                job.cancel()
            await asyncio.gather(*jobs, return_exceptions=True)
        self.record.crashed = self._world.truth.crash_reason
        self.record.images, self.record.posed = self._eyes.images, self._eyes.posed
        return self.record

    # -- the parts of the flight ----------------------------------------------------------------------------------

    async def _fly_parts(self) -> None:
        over = {"position": (0.0, 0.0, HEIGHT), "frame": SetpointFrame.PAD}
        aside, across = over | {"position": (-0.5, 0.0, HEIGHT)}, over | {"position": (0.5, 0.0, HEIGHT)}
        parts: tuple[tuple[str, type[Setpoint], dict[str, Any], float | None], ...] = (
            ("take-off", TakeOffSetpoint, {"height": HEIGHT}, None),
            ("hold", HoldSetpoint, {}, 12.0),
            ("aside", PositionSetpoint, aside, None),
            ("step", PositionSetpoint, across, 6.0),
            ("back", PositionSetpoint, over, None),
            ("wait", PositionSetpoint, over, max(0.0, PAD_STARTS - self._loop.time()) + 1.0),
            ("follow", PositionSetpoint, over, 8.0),
            ("land", LandSetpoint, {}, None),
        )
        for part, kind, fields, seconds in parts:
            if part == "hold":
                kind, fields = PositionSetpoint, over
            elif part == "wait":
                seconds = max(0.0, PAD_STARTS - self._loop.time()) + 1.0
            self._begin(part)
            if not await self._stream(kind, fields, seconds):
                break
        self.record.outcome = "" if self._status is None else self._status.reason

    async def _stream(self, kind: type[Setpoint], fields: dict[str, Any], seconds: float | None) -> bool:
        """Stream a setpoint for some time, or until it is done; whether the flight goes on."""
        began = self._loop.time()
        assert self._lease is not None
        while self._loop.time() - began < (LONGEST if seconds is None else seconds):
            self._sequence += 1
            setpoint = kind(epoch=self._lease.epoch, sequence=self._sequence, ttl=0.3, **fields)
            payload = encode(setpoint)
            proof = sign(self._lease.secret, kind.suffix, payload)
            self._flight.setpoint_arrived(
                kind, self._loop.time(), payload, self._flight.signed_for(kind, payload, proof)
            )
            await asyncio.sleep(PERIOD)
            status = self._status
            if status is None or status.lease is None:
                return False
            is_new = self._loop.time() - began > 2 * PERIOD
            if seconds is None and is_new and status.is_done and kind is not LandSetpoint:
                return True
        return seconds is not None

    async def _take_lease(self) -> None:
        granted = await self._flight.lease(LeaseRequest(action="take", holder="demo"))
        assert isinstance(granted, LeaseGrant)
        self._lease = granted
        await self._wait(lambda: self._status is not None and self._status.lease is not None, 1.0)

    def _is_ready(self) -> bool:
        runs = self._facts.motors_running(self._loop.time())
        return bool(self._link.is_up and self._link.dialect.extern_control is not None and runs)

    async def _wait(self, claim: Callable[[], bool], within: float) -> bool:
        """Wait for a claim to hold; whether it did in time."""
        deadline = self._loop.time() + within
        while not claim():
            if self._loop.time() >= deadline:
                return False
            await asyncio.sleep(PERIOD)
        return True

    def _begin(self, part: str) -> None:
        self._part = part
        self.record.parts[part] = self._loop.time()

    def _moved(self, now: float) -> None:
        """Keep what is true now, twenty times a second."""
        if now < self._kept_at:
            return
        self._kept_at = now + KEPT
        target = self._scene.platform.pose_at(now).position_enu
        x, y, z = (float(part) for part in self._world.truth.position_enu - target)
        east, north, up = (float(part) for part in target)
        error, estimate = self._error, self._estimate
        if error is not None and now - error.stamp.monotonic > OLD:
            error = None
        if estimate is not None and now - estimate.stamp.monotonic > OLD:
            estimate = None
        moment = Moment(
            at=now,
            position=(x, y, z),
            target=(east, north, up),
            goal=None if error is None else error.goal,
            estimate=None if estimate is None else estimate.position,
            part=self._part,
        )
        self.record.moments.append(moment)
        self._watcher(moment, self._status)


async def rehearse(*, seed: int, wind: str, fps: float, watcher: Watcher) -> Rehearsed:
    """Fly the demonstration once; see `Rehearsal`."""
    return await Rehearsal(seed=seed, wind=wind, fps=fps, watcher=watcher).fly()

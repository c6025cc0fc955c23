"""A flight by a source of poses that goes wrong, alone or beside another eye, in virtual time.

The other eye is a camera over the same target, as the noise model of `lab control`, or a second motion capture system.
What is drawn from the seed: the fault, its size, when it begins, the wind, the other eye, and who is heard first.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import numpy as np

from lab.control.corerig import pose_of, stamp
from lab.rigs.positionflight import (
    BACK_FROM,
    HEIGHT,
    LAND_AT,
    LOOK,
    SETTLED,
    SOURCE,
    STEP_FROM,
    UNNAMED,
    PositionFlight,
)
from mkdaemon.config.positions import PositionSource
from mkdaemon.control.actions import PublishEstimate, ReportCommand
from mkdaemon.control.events import EyeStats, PathUploaded, PoseSeen, SightRefused
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.control.regulator.autopilot import Goal
from mkdaemon.positions.positioneye import PositionEye
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest
from mkdaemon.telemetry.setpoint import PathSetpoint, Setpoint
from mkdaemon.telemetry.vision import EyeState, PoseRefused, VisionPose
from mksim.config import WindClass
from mksim.physics.mocap import FAULTS, RATE, FaultSize, Measured, MotionCapture

ASIDE: Final = (0.5, 0.3)
"""Corner of the rectangle in which everything is flown; the pad is the opposite one [m]."""
SPEED: Final = 0.3
"""Along the path [m/s]."""
JOINS: Final = 1.0
"""The eye that is not heard first begins then [s]."""
FRAME_SD: Final = 0.004
"""Deviation of a frame that was measured against the target's, each axis [m]."""
CAMERA, SECOND = "down", "second"
"""Names of the other eye."""


class Moment(StrEnum):
    """When a fault begins."""

    GROUND = "ground"
    HOLD = "hold"
    GOTO = "goto"
    PATH = "path"
    LANDING = "landing"


BEGINS: Final = {
    Moment.GROUND: (0.0, 0.0),
    Moment.HOLD: (15.0, 25.0),
    Moment.GOTO: (STEP_FROM + 0.1, BACK_FROM + 3.0),
    Moment.PATH: (STEP_FROM + 0.1, LAND_AT - 1.0),
    Moment.LANDING: (LAND_AT + 0.1, LAND_AT + 3.0),
}
"""Earliest and latest begin of a fault in each [s]."""


@dataclass(frozen=True, slots=True)
class WrongSource:
    """What is flown.

    Attributes:
        seed: of everything random.
        wind: class.
        fault: of the source.
        moment: in which it begins.
        at: when [s].
        size: of the fault.
        other: name of the other eye; empty for none.
        is_first: the source that goes wrong is heard before the other.
    """

    seed: int
    wind: WindClass
    fault: str
    moment: Moment
    at: float
    size: FaultSize
    other: str
    is_first: bool


def drawn(seed: int) -> WrongSource:
    """Draw a flight: offsets of 0.25 to 1 m, delays of 0.3 to 0.8 s, bodies 0.5 to 1.5 m away from the pad."""
    rng = random.Random(f"{seed} wrong source")
    moment = rng.choice(tuple(Moment))
    around, far, beside = rng.uniform(-math.pi, math.pi), rng.uniform(0.25, 1.0), rng.uniform(0.5, 1.5)
    size = FaultSize(
        offset=(far * math.cos(around), far * math.sin(around), rng.uniform(-0.1, 0.1)),
        delay=rng.uniform(0.3, 0.8),
        axis=rng.choice((0, 1)),
        carried=(rng.uniform(0.8, 1.5), rng.uniform(-1.0, -0.6), rng.uniform(0.3, 1.8)),
        beside=(-beside * abs(math.cos(around)), -beside * abs(math.sin(around)), rng.uniform(0.0, 0.3)),
    )
    return WrongSource(
        seed=seed,
        wind=rng.choice((WindClass.INDOOR, WindClass.LIGHT)),
        fault=rng.choice(tuple(FAULTS)),
        moment=moment,
        at=round(rng.uniform(*BEGINS[moment]), 2),
        size=size,
        other=rng.choice(("", CAMERA, SECOND)),
        is_first=rng.random() < 0.5,
    )


FOLLOWED: Final = 0.5
"""A tilt that follows a pose has its effect within this time [s]."""


class WrongSourceFlight(PositionFlight):
    """One flight.

    Attributes:
        plan: what is flown.
        contradicted: when the estimate contradicted which eyes, in flight [s].
        refused: why setpoints were refused.
        accused: states of the other source that name it as wrong, with their times [s].
    """

    def __init__(self, plan: WrongSource) -> None:
        """Prepare."""
        super().__init__(plan.seed, plan.wind, plan.fault, plan.at, frame_sd=0.01)
        self.plan = plan
        self.capture.size = plan.size
        self.contradicted: list[tuple[float, tuple[str, ...]]] = []
        self.refused: list[str] = []
        self.accused: list[tuple[float, EyeState, str]] = []
        self._noise = random.Random(f"{plan.seed} frames")
        self._second = MotionCapture(plan.seed + 500_000)
        self._second_eye = PositionEye(PositionSource(name=SECOND, target="pad", frame_sd=0.01))
        if plan.other == SECOND:
            self.eye.compare_with([self._second_eye])
            self._second_eye.compare_with([self.eye])
        self._frame = np.array([self._noise.gauss(0.0, FRAME_SD) for _ in range(3)])
        self._begins = 0.0 if plan.is_first or not plan.other else JOINS
        other_begins = 0.006 if self._begins else JOINS
        self._taken = len(self.actions)
        if plan.other == CAMERA:
            self._at(other_begins, self._photograph)
        elif plan.other:
            self._at(other_begins, self._measure)
        self._path = ""
        if plan.moment is Moment.PATH:
            x, y = ASIDE
            corners = ((0.0, 0.0), (x, 0.0), (x, y), (0.0, y), (0.0, 0.0))
            points = [
                PathPoint(position=(*each, HEIGHT), speed=SPEED if number else None)
                for number, each in enumerate(corners)
            ]
            reply = self.core.feed(PathUploaded(PathUploadRequest(points=tuple(points))), 0.0)
            assert reply.refusal is None and self.core.path_stored is not None
            self._path = self.core.path_stored.id

    def _goal_at(self, t: float) -> Goal:
        east = ASIDE[0] if STEP_FROM <= t < BACK_FROM else 0.0
        return Goal(position=np.array([east, 0.0, HEIGHT]), yaw=None)

    def _setpoint(self, goal: Goal, at: float) -> Setpoint:
        if self._path and STEP_FROM <= at < LAND_AT:
            return PathSetpoint(epoch=self._epoch, sequence=self._sequence, ttl=0.3, path=self._path)
        return super()._setpoint(goal, at)

    # -- the other eye --------------------------------------------------------------------------------------------

    def _expose(self, at: float) -> None:
        if at < self._begins:
            self._at(self._begins, self._expose)
        else:
            super()._expose(at)

    def _photograph(self, at: float) -> None:
        """Expose an image of the camera."""
        camera = self._flight.camera
        self._at(at + 1 / camera.rate, self._photograph)
        view = camera.look(at, self._world.truth.enu_from_flu, self._place(at), self._noise)
        if view is not None:
            delay = max(0.01, camera.latency + self._noise.gauss(0.0, camera.jitter))
            self._at(at + delay, lambda now: self.core.feed(PoseSeen(pose_of(view)), now))

    def _measure(self, at: float) -> None:
        """Expose of the second system."""
        self._at(at + 1.0 / RATE, self._measure)
        measured = self._second.measure(at, self._world.truth)
        if measured is not None:
            self._reports += 1
            shifted = Measured(measured.position + self._frame, measured.rotation)
            report = shifted.report(1, self._reports)
            self._at(at + measured.latency, lambda now: self._take_other(report, now))

    def _take_other(self, report: Any, now: float) -> None:
        for _, value in self._second_eye.take(report, now, now, stamp(now), is_flown=self.core.is_in_air):
            if isinstance(value, VisionPose):
                self.core.feed(PoseSeen(value), now)
            elif isinstance(value, PoseRefused):
                self.core.feed(SightRefused(value), now)

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        self._second_eye.attitude_received(at, pitch, roll)
        super()._hear(pitch, roll, yaw, at)

    def _look(self, at: float) -> None:
        super()._look(at)
        if not self.plan.other:
            return
        stats = self._second_eye.stats(at, stamp(at))
        if self.plan.other == CAMERA:
            fit = {"camera": CAMERA, "state": EyeState.OK, "reason": "", "processed": 1, "trusted_for": None}
            stats = stats.model_copy(update=fit)
        elif at >= JOINS + SETTLED and stats.state not in UNNAMED:
            self.accused.append((at, stats.state, stats.reason))
        self.core.feed(EyeStats(stats), at)

    def _control(self, at: float) -> None:
        super()._control(at)
        for _, action in self.actions[self._taken :]:
            if isinstance(action, PublishEstimate) and action.value.contradicting and self.core.phase in IN_FLIGHT:
                self.contradicted.append((at, action.value.contradicting))
            elif isinstance(action, ReportCommand) and action.result.token is not None:
                self.refused.append(action.result.reason or "")
        self._taken = len(self.actions)

    # -- what became of it ----------------------------------------------------------------------------------------

    @property
    def named_by(self) -> tuple[float, str]:
        """When the source was named [s], and how; infinite and empty where it was not.

        By its state, by the estimate that contradicts it, or by what keeps the aircraft on the ground.
        """
        found = [(at, reason) for at, _, reason in self.named if at >= self._begins + SETTLED]
        found += [(at, "contradicts the other") for at, names in self.contradicted if names == (SOURCE,)]
        if not self._has_flown:
            waits = (self.refused[-1:] or [self.waited_for])[0]
            found += [(self.handover, waits)] if waits else []
        return min(found, default=(math.inf, ""))

    @property
    def moved(self) -> float:
        """Farthest out of the rectangle that is flown in, until the core lets go [m]."""
        return self._strayed((self.released[0][0] if self.released else math.inf) + LOOK)

    @property
    def led(self) -> float:
        """The same while the source is used, and a little after that [m]: then a silent one is flown on as well."""
        return min(self.moved, self._strayed(max(self.used, default=self.plan.at) + FOLLOWED))

    def _strayed(self, until: float) -> float:
        places = [place[:2] for at, place in zip(self.record.times, self.record.positions, strict=True) if at <= until]
        beyond = [np.maximum(np.maximum(-place, place - ASIDE), 0.0) for place in places]
        return max((float(np.hypot(*each)) for each in beyond), default=0.0)

"""A flight by motion capture alone, through the flight core, in virtual time: take-off, hold, a step, landing.

No tag is in the world. The simulated system measures the truth and plays its faults. What it reports passes the checks
of the product (`PositionEye`), and the core decides each stick frame. After a release the safety pilot flies.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np

from lab.control.corerig import CoreRig, stamp
from lab.control.flights import Flight
from mkdaemon.config.positions import PositionSource
from mkdaemon.control.actions import PublishStatus, ReleaseAircraft
from mkdaemon.control.events import EyeStats, MotorsReported, PoseSeen, Released, SightRefused
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.control.regulator.autopilot import Goal
from mkdaemon.positions.positioneye import PositionEye
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.control import ReleaseOutcome
from mkdaemon.telemetry.setpoint import LandSetpoint, PositionSetpoint, Setpoint, SetpointFrame, TakeOffSetpoint
from mkdaemon.telemetry.vision import EyeState, PoseRefused, VisionPose, VisionStats
from mksim.config import WindClass
from mksim.physics.hand_flight import HandFlight
from mksim.physics.mocap import RATE, Measured, MotionCapture
from mksim.physics.truth import Truth
from mksim.physics.world import StickInput

HEIGHT: Final = 1.5
"""Flown [m]."""
HOLD_FROM, STEP_FROM, BACK_FROM, LAND_AT = 14.0, 26.0, 32.0, 37.0
"""Parts of the flight begin then [s]; the first is the take-off."""
LENGTH: Final = 54.0
"""Longest flight [s]."""
LOOK: Final = 0.1
"""Between two looks at the state of a source [s]."""
SETTLED: Final = 0.5
"""A source that has just begun may be missing until then [s]."""
AFTERWARDS: Final = 6.0
"""Time after a release in which the safety pilot must be able to fly it [s]."""
SOURCE: Final = "mocap"
UNNAMED: Final = (EyeState.OK, EyeState.DISPUTED)
"""States that name no source as wrong."""


class PositionFlight(CoreRig):
    """One flight.

    Attributes:
        capture: the motion capture system.
        eye: the source of poses, as the daemon has it.
        named: states that name the source as wrong after its fault began, with the time of each [s] and its reason.
        used: times at which a pose reached the core in flight after the fault began [s].
        released: when and why the core let go.
    """

    handover = 3.0

    def __init__(self, seed: int, wind: WindClass, fault: str = "", at: float = 0.0, **source: Any) -> None:
        """Prepare.

        Args:
            seed: of everything random.
            wind: class.
            fault: of the motion capture system; empty for none.
            at: when it begins [s].
            source: keys of its section.
        """
        flight = Flight(seed=seed, seconds=LENGTH, start=0.0, place=(0.05, -0.04), wind=wind, land_at=LAND_AT)
        super().__init__(replace(flight, goal=self._goal_at))
        self.capture = MotionCapture(seed)
        self.eye = PositionEye(PositionSource(**{"name": SOURCE, "target": "pad"} | source))
        self.named: list[tuple[float, EyeState, str]] = []
        self.used: list[float] = []
        self.released: list[tuple[float, str]] = []
        self._fault, self._fault_at, self._count, self._has_flown = fault, at, 0, False
        self._reports = 0
        self._at(0.005, self._look)

    def _goal_at(self, t: float) -> Goal:
        return Goal(position=np.array([0.5 if STEP_FROM <= t < BACK_FROM else 0.0, 0.0, HEIGHT]), yaw=None)

    def _expose(self, at: float) -> None:
        """Measure at the rate of the system; its poses take the place of a camera's."""
        self._at(at + 1.0 / RATE, self._expose)
        self.capture.fault = self._fault if at >= self._fault_at else ""
        measured = self.capture.measure(at, self._world.truth)
        if measured is not None:
            self._reports += 1
            self._at(at + measured.latency, self._arrive(measured, self._reports))

    def _arrive(self, measured: Measured, sequence: int) -> Any:
        report = measured.report(1, sequence)

        def take(now: float) -> None:
            self._take(self.eye.take(report, now, now, stamp(now), is_flown=self.core.is_in_air), now)

        return take

    def _take(self, values: list[tuple[str, Telemetry]], now: float) -> None:
        for _, value in values:
            if isinstance(value, VisionPose):
                self.core.feed(PoseSeen(value), now)
                if self._fault and now >= self._fault_at and self.core.phase in IN_FLIGHT:
                    self.used.append(now)
            elif isinstance(value, PoseRefused):
                self.core.feed(SightRefused(value), now)

    def _look(self, at: float) -> None:
        self._at(at + LOOK, self._look)
        stats: VisionStats = self.eye.stats(at, stamp(at))
        self.core.feed(EyeStats(stats), at)
        if self._fault and at >= max(self._fault_at, SETTLED) and stats.state not in UNNAMED:
            self.named.append((at, stats.state, stats.reason))

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        self.eye.attitude_received(at, pitch, roll)
        super()._hear(pitch, roll, yaw, at)

    def _tell_pilot(self, event: Any) -> None:
        """The pilot sees the aircraft itself."""

    def _control(self, at: float) -> None:
        self.core.feed(MotorsReported(are_running=True), at)
        before = len(self.actions)
        super()._control(at)
        for _, action in self.actions[before:]:
            if isinstance(action, ReleaseAircraft):
                self.released.append((at, action.reason))
                self.core.feed(Released(ReleaseOutcome.CONFIRMED), at)
                self.is_silent = True
        if self.core.phase in IN_FLIGHT:
            self._has_flown = True
        elif self._has_flown and self._world.pilot.program is None and not self._world.truth.on_ground:
            self._world.pilot.program = HandFlight(height=self._world.truth.position_enu[2] - 0.1, flying=True)

    def _sticks(self) -> StickInput:
        """What the FlightCtrl gets: ours, or after a release those of the pilot."""
        if self._world.pilot.program is None or self.core.phase in IN_FLIGHT:
            return super()._sticks()
        pilot = self._world.pilot
        return StickInput(pilot.pitch, pilot.roll, pilot.yaw, pilot.gas + 127.0, motors_running=True)

    def _is_over(self, at: float) -> bool:
        """Whether the pilot has had the aircraft for a while, or it does not take off."""
        is_grounded = at > HOLD_FROM and not self._has_flown
        return super()._is_over(at) or is_grounded or bool(self.released and at > self.released[0][0] + AFTERWARDS)

    def _setpoint(self, goal: Goal, at: float) -> Setpoint:
        fields: dict[str, Any] = {"epoch": self._epoch, "sequence": self._sequence, "ttl": 0.3}
        if at < HOLD_FROM:
            return TakeOffSetpoint(**fields, height=HEIGHT)
        if at >= LAND_AT:
            return LandSetpoint(**fields)
        x, y, z = (float(part) for part in goal.position)
        return PositionSetpoint(**fields, position=(x, y, z), frame=SetpointFrame.PAD)

    @property
    def world_truth(self) -> Truth:
        """The physics."""
        return self._world.truth

    @property
    def has_flown(self) -> bool:
        """Whether the core ever flew."""
        return self._has_flown

    @property
    def waited_for(self) -> str:
        """What the take-off waits for in the end; empty where it flies."""
        shown = [action for _, action in self.actions if isinstance(action, PublishStatus)]
        return shown[-1].reason if shown and not self._has_flown else ""

    def hold_rms(self, start: float, end: float) -> float:
        """Horizontal RMS of the true place against the goal between two times [m]."""
        moments = zip(self.record.times, self.record.errors, strict=True)
        squares = [error[0] ** 2 + error[1] ** 2 for at, error in moments if start <= at < end]
        return math.sqrt(sum(squares) / len(squares)) if squares else math.nan

"""A flight in virtual time: physics, radio, camera and telemetry as models; estimator and autopilot as in the product.

The aircraft is the simulator's physics without its boards, and the camera a noise model instead of rendered images, so
that hundreds of flights take minutes.
"""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable
from typing import Final

import numpy as np

from lab.control.flights import RADIO, STOOD, Flight, Record
from mkdaemon.config.control import LimiterConfig
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import NO_FILTER, AircraftModel
from mkdaemon.control.estimator.values import StickCommand, TargetView
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.linear import Array
from mkdaemon.control.manoeuvres.land import Landing, LandingLimits, LandingPhase
from mkdaemon.control.regulator.autopilot import Autopilot, Goal
from mkdaemon.control.regulator.horizontal import HorizontalCosts
from mkdaemon.control.regulator.reference import ReferenceLimits
from mkdaemon.control.regulator.vertical import VerticalGains
from mksim.config import AirframeConfig, ChannelConfig, FlightConfig, SensorConfig
from mksim.physics.attitude_loop import AttitudeGains
from mksim.physics.deck import MovingDeck
from mksim.physics.world import DT, StartState, StickInput, World
from mksim.radio import BITS_PER_BYTE, PACKET_GAP_BYTES, Air

CONTROL_PERIOD: Final = 0.02
"""[s]."""
TELEMETRY_PERIOD: Final = 0.02
"""[s]."""
BOARD_AGE: Final = 0.0255
"""The FlightCtrl reports an attitude that it collected so long ago, mean [s]; docs/lab/genuine.md."""
BOARD_TIME: Final = 0.0014
"""From the last byte of a stick frame to its being in the FlightCtrl's memory [s]; docs/lab/genuine.md."""
RECEIVER_FRAME: Final = 0.0225
"""Sticks are evaluated on a receiver frame [s]."""
HOVER: Final = 125.0
"""Motor set point that carries the simulated 1.25 kg at 3.2 V a cell [count of 254]; docs/simulator.md."""
HOVER_LOSS: Final = 1.7
"""How much more gas that takes, because the FlightCtrl computes in whole numbers [count of 254]; docs/simulator.md."""
FIRST_HOVER: Final = 118.0
"""Hover throttle the product begins with [count of 254]."""
ATTITUDE_BYTES: Final = 26
"""Length of an attitude frame [byte]."""
STICK_BYTES: Final = 18
"""Length of a stick frame [byte]."""
CARRIES: Final = 0.9
"""More throttle than this share of `HOVER` still carries most of the weight."""
WORLD_SIZE: Final = 12.0
"""An aircraft farther from its target than this is lost [m]."""


def believed_model(gains: AttitudeGains, radio: ChannelConfig = RADIO) -> AircraftModel:
    """The product's model of an aircraft whose parameter set is known, by a line whose round trips were measured."""
    return AircraftModel(
        rad_per_count=gains.rad_per_count,
        a1=gains.a1,
        a2=gains.a2,
        leak=gains.ta,
        stick_filter=gains.ts or NO_FILTER,
        yaw_linear=gains.yaw_linear,
        yaw_square=gains.yaw_square,
    ).by_line(radio.latency_mean + wire_time(STICK_BYTES, radio))


def wire_time(size: int, radio: ChannelConfig) -> float:
    """Time that bytes take on the wire at either end [s]."""
    return size * BITS_PER_BYTE / radio.baud


class Rig:
    """One flight under way: events in the order of their times."""

    def __init__(self, flight: Flight) -> None:
        self.record = Record()
        self._flight = flight
        self._rng = random.Random(f"{flight.seed} flight")
        self._up, self._down = (Air(flight.radio, f"{flight.seed} {way}") for way in ("up", "down"))
        scale = math.sqrt(flight.mass / 1.25)
        config = FlightConfig(
            wind=flight.wind,
            airframe=AirframeConfig(mass=flight.mass, hover_count=min(180.0, HOVER * scale)),
            sensors=SensorConfig(fc_angle_scale=flight.attitude_scale),
        )
        start = StartState(*flight.place, height=flight.start, yaw=0.3)
        ground = MovingDeck(flight.pad_at, radius=0.7) if any(flight.pad) else None
        self._world = World(config, seed=flight.seed, start=start, gains=flight.gains, ground=ground)
        gas = round(HOVER * scale + HOVER_LOSS) if flight.start > 0.0 else 0
        self._held = self._acting = StickCounts(0, 0, 0, gas - 127)
        self._next_frame, self._frames = 0.0, 0
        self._sink, self._stands_since = 0.0, math.inf
        self._autopilot: Autopilot | None = None
        self._landing: Landing | None = None
        self._queue: list[tuple[float, int, Callable[[float], object]]] = []
        self._count = 0

    def fly(self) -> Record:
        """Fly to the end, or until the aircraft is lost."""
        self._at(0.004, self._expose)
        self._at(0.006, self._report)
        self._at(0.010, self._control)
        while not self.record.lost and self._queue[0][0] < self._flight.seconds:
            at, _, event = heapq.heappop(self._queue)
            self._move_world(at)
            self._watch(at)
            event(at)
            if self._is_over(at):
                break
        return self.record

    def _is_over(self, at: float) -> bool:
        """Whether nothing is left to see: the aircraft stands, by the physics and by the sticks on the line."""
        has_stood = at > max(self._stands_since, self._flight.land_at) + STOOD
        self.record.stands = has_stood and self._held.throttle + 127.0 < CARRIES * HOVER
        return self.record.stands

    def _at(self, at: float, event: Callable[[float], object]) -> None:
        self._count += 1
        heapq.heappush(self._queue, (at, self._count, event))

    def _place(self, at: float) -> Array:
        place: Array = self._world.truth.position_enu - self._flight.pad_at(at)
        return place

    def _move_world(self, until: float) -> None:
        world, record = self._world, self.record
        while world.now + DT <= until:
            if world.now >= self._next_frame:
                self._next_frame += RECEIVER_FRAME
                self._acting, self._frames = self._held, self._frames + 1
            world.step(self._sticks())
            self._stands_since = min(self._stands_since, world.now) if world.truth.on_ground else math.inf
            if world.now > self._flight.land_at and math.isnan(record.touched) and world.truth.on_ground:
                record.touched, record.touch_sink = world.now, self._sink
                record.touch_error = float(np.hypot(*self._place(world.now)[:2]))
            self._sink = -float(world.truth.velocity_enu[2])

    def _sticks(self) -> StickInput:
        """What the FlightCtrl gets."""
        s = self._acting
        return StickInput(s.pitch, -s.roll, s.yaw, s.throttle + 127.0, motors_running=True, frame=self._frames)

    def _watch(self, at: float) -> None:
        truth, place = self._world.truth, self._place(at)
        if truth.crashed:
            self.record.lost = truth.crash_reason
        elif np.abs(place[:2]).max() > WORLD_SIZE or not 0.0 <= place[2] < WORLD_SIZE:
            self.record.lost = f"left the volume at {at:.1f} s"

    def _expose(self, at: float) -> None:
        camera = self._flight.camera
        self._at(at + 1 / camera.rate, self._expose)
        view = camera.look(at, self._world.truth.enu_from_flu, self._place(at), self._rng)
        if view is not None:
            delay = max(0.01, camera.latency + self._rng.gauss(0, camera.jitter))
            self._at(at + delay, lambda now: self._see(view, now))

    def _see(self, view: TargetView, at: float) -> None:
        flight = self._flight
        if self._autopilot is None:
            estimator = Estimator(flight.model or believed_model(flight.gains, flight.radio), view, FIRST_HOVER)
            estimator.advance(at)
            self._autopilot = Autopilot(
                estimator,
                costs=HorizontalCosts(),
                gains=VerticalGains(),
                level_limits=ReferenceLimits(1.2, 1.4),
                height_limits=ReferenceLimits(0.6, 0.8),
                estimate=estimator.estimate(at),
            )
        self._autopilot.estimator.advance(at)
        self._autopilot.estimator.target_seen(view, at)

    def _report(self, at: float) -> None:
        self._at(at + TELEMETRY_PERIOD, self._report)
        sensors, yaw = self._world.sensors, self._world.truth.yaw
        pitch, roll = sensors.fc_angle_pitch, sensors.fc_angle_roll
        self._at(at + BOARD_AGE, lambda now: self._transmit(pitch, roll, yaw, now))

    def _transmit(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        arrival = self._arrival(self._down, ATTITUDE_BYTES, at)
        if arrival is not None:
            self._at(arrival, lambda now: self._hear(pitch, roll, yaw, now))

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        if self._autopilot is not None:
            estimator = self._autopilot.estimator
            estimator.advance(at)
            estimator.attitude_received(at - estimator.line.attitude_age, pitch, roll, yaw)

    def _control(self, at: float) -> None:
        self._at(at + CONTROL_PERIOD, self._control)
        goal = self._flight.goal(at)
        if self._autopilot is not None:
            estimator = self._autopilot.estimator
            believed = estimator.estimate(at)
            if at >= self._flight.land_at:
                self._landing = self._landing or Landing(LandingLimits(), believed)
                goal = self._landing.goal(believed, goal.yaw, CONTROL_PERIOD)
            sticks = self._autopilot.sticks(goal, at)
            if self._landing is not None and self._landing.phase is LandingPhase.DOWN:
                sticks = StickCounts(0, 0, 0, LimiterConfig().min_throttle)  # as the manoeuvre does
            gas = sticks.throttle + 127.0
            estimator.sent(StickCommand(at, sticks.pitch, sticks.roll, sticks.yaw, gas))
            self._send(sticks, at)
        self._keep(goal, at)

    def _send(self, sticks: StickCounts, at: float) -> None:
        arrival = self._arrival(self._up, STICK_BYTES, at)
        if arrival is not None:
            self._at(arrival + BOARD_TIME, lambda now: self._hold(sticks))

    def _arrival(self, air: Air, size: int, at: float) -> float | None:
        """When the last byte of a frame that is a packet by itself arrives [s]; None if it is lost."""
        radio = self._flight.radio
        handed_over = at + wire_time(size, radio)
        leaves = air.carry(size, handed_over, handed_over + wire_time(PACKET_GAP_BYTES, radio))
        return None if leaves is None else leaves + wire_time(size, radio)

    def _hold(self, sticks: StickCounts) -> None:
        self._held = sticks

    def _keep(self, goal: Goal, at: float) -> None:
        place = self._place(at)
        self.record.times.append(at)
        self.record.positions.append(place)
        self.record.errors.append(place - goal.position)

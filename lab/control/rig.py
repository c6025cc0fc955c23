"""A flight in virtual time: physics, radio, camera and telemetry as models, estimator and autopilot as in the product.

The aircraft is the simulator's physics. The camera is a noise model instead of rendered images, fitted to
docs/accuracy.md, so that hundreds of flights take minutes; `lab.control.rendered` flies with images.
"""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from mkdaemon.config.sim_flight import AirframeConfig, FlightConfig, SensorConfig, WindClass
from mkdaemon.control.estimator.estimator import Estimator, StickCommand, TargetView
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.tuning import NOMINAL, Tuning
from mkdaemon.control.guidance.autopilot import Autopilot, AutopilotSticks, Goal, at_origin
from mkdaemon.control.guidance.horizontal import HorizontalCosts
from mkdaemon.control.guidance.landing import Landing, LandingLimits
from mkdaemon.control.guidance.reference import ReferenceLimits
from mkdaemon.control.guidance.vertical import VerticalGains
from mkdaemon.control.linear import Array
from mkdaemon.sim.physics.attitude_loop import EASY, AttitudeGains
from mkdaemon.sim.physics.deck import MovingDeck
from mkdaemon.sim.physics.world import DT, StartState, StickInput, World

CONTROL_PERIOD: Final = 0.02
"""[s]."""
RECEIVER_FRAME: Final = 0.0225
"""Sticks are evaluated on a receiver frame [s]."""
HOVER: Final = 125.0
"""Gas of the simulated airframe's hover [count of 254]."""


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A camera that looks down, and the eyes behind it.

    Attributes:
        focal: [px].
        width: [px].
        height: [px].
        rate: images [Hz].
        noise: standard deviation of a measured edge [px].
        latency: from the exposure to the pose [s].
        jitter: of the latency [s].
        stamp_error: constant error of the time stamps [s].
        missing: share of images without a pose.
        tags: sizes, largest first [m].
        gone: times in which the target is out of sight, as (from, to) [s].
    """

    focal: float = 420.0
    width: int = 640
    height: int = 480
    rate: float = 30.0
    noise: float = 0.35
    latency: float = 0.080
    jitter: float = 0.008
    stamp_error: float = 0.0
    missing: float = 0.0
    tags: tuple[float, ...] = (0.30, 0.06)
    gone: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class RadioModel:
    """The serial line with a radio in it: latency and bursts of loss (Gilbert and Elliott).

    Attributes:
        fastest: [s].
        slowest: of ordinary packets [s].
        spikes: share of packets that take up to `spike` [s].
        spike: [s].
        loss: share of packets lost.
    """

    fastest: float = 0.012
    slowest: float = 0.025
    spikes: float = 0.03
    spike: float = 0.062
    loss: float = 0.01


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight to fly.

    Attributes:
        seed: of everything random.
        seconds: length [s].
        wind: class.
        goal: wanted position at a time of the flight.
        gains: of the aircraft's attitude loop.
        mass: [kg].
        model: what the product believes of the aircraft; None for the truth.
        tuning: of the estimator.
        costs: of the regulator.
        vertical: gains of the height.
        camera: the eyes.
        radio: the line.
        pad: velocity of the target [m/s].
        attitude_scale: what the boards report over what they believe.
        land_at: when to begin to land [s].
        landing: how.
    """

    seed: int
    seconds: float = 40.0
    wind: WindClass = WindClass.INDOOR
    goal: Callable[[float], Goal] = field(default=lambda t: at_origin(2.0))
    gains: AttitudeGains = field(default_factory=lambda: AttitudeGains.from_parameters(**EASY))
    mass: float = 1.25
    model: AircraftModel | None = None
    tuning: Tuning = NOMINAL
    costs: HorizontalCosts = field(default_factory=HorizontalCosts)
    vertical: VerticalGains = field(default_factory=VerticalGains)
    camera: CameraModel = field(default_factory=CameraModel)
    radio: RadioModel = field(default_factory=RadioModel)
    pad: tuple[float, float] = (0.0, 0.0)
    attitude_scale: float = 1.0
    land_at: float = math.inf
    landing: LandingLimits = field(default_factory=LandingLimits)


@dataclass(slots=True)
class Record:
    """What happened.

    Attributes:
        times: (n,) [s].
        errors: true position less goal (n, 3) [m].
        positions: true position in the frame of the target (n, 3) [m].
        estimates: estimated position less true position (n, 3) [m].
        lost: why it ended early; empty when it flew to the end.
        innovation: the estimator's at the end.
        touched: when the feet first stood after `land_at` [s].
        touch_error: horizontal distance from the target's middle then [m].
        touch_sink: rate of descent then [m/s].
        landing: where the landing stood at the end.
    """

    times: list[float] = field(default_factory=list)
    errors: list[Array] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    estimates: list[Array] = field(default_factory=list)
    lost: str = ""
    innovation: float = math.nan
    touched: float = math.nan
    touch_error: float = math.nan
    touch_sink: float = math.nan
    landing: str = ""


class _Radio:
    """One direction."""

    def __init__(self, model: RadioModel, rng: random.Random) -> None:
        self._model, self._rng = model, rng
        self._busy = self._last = 0.0
        self._bad = False

    def arrival(self, now: float, size: int) -> float | None:
        """When a packet of so many bytes arrives; None for never."""
        model, rng = self._model, self._rng
        self._busy = max(now, self._busy) + size * 10 / 57600
        share = model.loss / 0.6
        self._bad = rng.random() > 0.25 if self._bad else rng.random() < 0.25 * share / (1 - share)
        if self._bad and rng.random() < 0.6:
            return None
        late = rng.uniform(model.slowest, model.spike) if rng.random() < model.spikes else None
        delay = late if late is not None else rng.uniform(model.fastest, model.slowest)
        self._last = max(self._busy + delay, self._last + 1e-4)
        return self._last


class _Pilotless:
    """Holds the last stick frame, evaluated on receiver frames."""

    def __init__(self) -> None:
        self.held = self.acting = AutopilotSticks(0, 0, 0, 0)
        self._next = 0.0

    def input(self, now: float) -> StickInput:
        if now >= self._next:
            self._next += RECEIVER_FRAME
            self.acting = self.held
        s = self.acting
        return StickInput(s.pitch, -s.roll, s.yaw, s.throttle + 127.0, motors_running=True)


def believed_model(gains: AttitudeGains) -> AircraftModel:
    """The product's model of an aircraft whose parameter set is known."""
    return AircraftModel(
        rad_per_count=gains.rad_per_count,
        a1=gains.a1,
        a2=gains.a2,
        leak=gains.ta,
        stick_filter=gains.ts or 0.011,
        yaw_linear=gains.yaw_linear,
        yaw_square=gains.yaw_square,
    )


def fly(flight: Flight) -> Record:
    """Fly one flight."""
    rng = random.Random(f"{flight.seed} flight")
    scale = math.sqrt(flight.mass / 1.25)
    config = FlightConfig(
        wind=flight.wind,
        airframe=AirframeConfig(mass=flight.mass, hover_count=min(180.0, HOVER * scale)),
        sensors=SensorConfig(fc_angle_scale=flight.attitude_scale),
    )
    pad = np.array([*flight.pad, 0.0])
    ground = MovingDeck(lambda t: pad * t, radius=0.7) if flight.pad != (0.0, 0.0) else None
    world = World(config, seed=flight.seed, start=StartState(height=1.9, yaw=0.3), gains=flight.gains, ground=ground)
    up, down = _Radio(flight.radio, rng), _Radio(flight.radio, rng)
    camera, sticks, record = flight.camera, _Pilotless(), Record()
    sticks.held = sticks.acting = AutopilotSticks(0, 0, 0, round(HOVER * scale) - 127)
    model = flight.model or believed_model(flight.gains)
    autopilot: Autopilot | None = None
    landing: Landing | None = None
    sinking = 0.0
    queue: list[tuple[float, int, str, object]] = []
    count = 0

    def push(at: float, kind: str, what: object = None) -> None:
        nonlocal count
        count += 1
        heapq.heappush(queue, (at, count, kind, what))

    push(0.004, "expose")
    push(0.006, "telemetry")
    push(0.010, "control")
    while queue and queue[0][0] < flight.seconds:
        at, _, kind, what = heapq.heappop(queue)
        while world.now + DT <= at:
            world.step(sticks.input(world.now))
            if at > flight.land_at and math.isnan(record.touched):
                if world.truth.on_ground:
                    record.touched, record.touch_sink = world.now, -sinking
                    record.touch_error = float(np.hypot(*(world.truth.position_enu - pad * world.now)[:2]))
                sinking = float(world.truth.velocity_enu[2])
        truth = world.truth
        place = truth.position_enu - pad * at
        if record.landing == "down" and at > record.touched + 1.0:
            break
        if truth.crashed or np.abs(place[:2]).max() > 12 or not 0.0 <= place[2] < 12:
            record.lost = truth.crash_reason or f"left the volume at {at:.1f} s"
            break
        if kind == "expose":
            push(at + 1 / camera.rate, "expose")
            view = look(camera, at, truth.enu_from_flu, place, rng)
            if view is not None:
                push(at + max(0.01, camera.latency + rng.gauss(0, camera.jitter)), "view", view)
        elif kind == "view":
            assert isinstance(what, TargetView)
            if autopilot is None:
                estimator = Estimator(model, flight.tuning, what, 118.0)
                estimator.advance(at)
                autopilot = Autopilot(
                    estimator,
                    costs=flight.costs,
                    gains=flight.vertical,
                    level_limits=ReferenceLimits(1.2, 1.5),
                    height_limits=ReferenceLimits(0.6, 0.8),
                    now=at,
                )
            autopilot.estimator.advance(at)
            autopilot.estimator.target_seen(what)
        elif kind == "telemetry":
            push(at + 0.02, "telemetry")
            heard = down.arrival(at, 26)
            if heard is not None:
                s = world.sensors
                push(heard, "heard", (heard - 0.024, s.fc_angle_pitch, s.fc_angle_roll, truth.yaw))
        elif kind == "heard" and autopilot is not None:
            autopilot.estimator.advance(at)
            autopilot.estimator.attitude_received(*what)  # type: ignore[misc]
        elif kind == "act":
            assert isinstance(what, AutopilotSticks)
            sticks.held = what
        elif kind == "control":
            push(at + CONTROL_PERIOD, "control")
            goal = flight.goal(at)
            if autopilot is not None:
                if at >= flight.land_at:
                    now = autopilot.estimator.estimate(at)
                    landing = landing or Landing(flight.landing, now)
                    goal = landing.goal(now, goal.yaw, CONTROL_PERIOD)
                    record.landing = landing.phase.value
                counts = autopilot.sticks(goal, at)
                written = at + 0.0038
                estimator = autopilot.estimator
                estimator.sent(StickCommand(written, counts.pitch, counts.roll, counts.yaw, counts.throttle + 127.0))
                arrival = up.arrival(at, 18)
                if arrival is not None:
                    push(arrival, "act", counts)
                believed = estimator.estimate(at)
                record.estimates.append(believed.position - place)
                record.innovation = estimator.innovation
            record.times.append(at)
            record.positions.append(place)
            record.errors.append(place - goal.position)
    return record


def look(camera: CameraModel, at: float, enu_from_flu: Array, place: Array, rng: random.Random) -> TargetView | None:
    """What an image shows of a target at the origin; None where it shows none."""
    if rng.random() < camera.missing or any(start <= at < end for start, end in camera.gone):
        return None
    seen = enu_from_flu.T @ -place
    depth = -seen[2]
    if depth < 0.05:
        return None
    for size in camera.tags:
        half = size / 2 * 1.15
        inside = camera.focal * (abs(seen[1]) + half) < camera.width / 2 * depth
        inside = inside and camera.focal * (abs(seen[0]) + half) < camera.height / 2 * depth
        if inside and camera.focal * size / depth > 22:
            break
    else:
        return None
    lateral = depth * camera.noise / camera.focal / 2
    along = depth**2 * camera.noise / (camera.focal * size) / 1.4
    angle = camera.noise * 2 * depth**2 / (camera.focal * size * size)
    twist = np.array([rng.gauss(0, angle), rng.gauss(0, angle), rng.gauss(0, 0.01)])
    measured = seen + np.array([rng.gauss(0, lateral), rng.gauss(0, lateral), rng.gauss(0, along)])
    rotation = rotation_of(twist) @ enu_from_flu
    cov = np.zeros((6, 6))
    p = -rotation @ measured
    cross = np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])
    body = np.diag([lateral**2, lateral**2, along**2])
    turn = np.diag([angle**2, angle**2, 0.01**2])
    cov[:3, :3] = rotation @ body @ rotation.T + cross @ turn @ cross.T
    cov[:3, 3:] = -cross @ turn
    cov[3:, :3] = cov[:3, 3:].T
    cov[3:, 3:] = turn
    return TargetView(at + camera.stamp_error, measured, rotation, cov)


def rotation_of(vector: Array) -> Array:
    """Rotation matrix of a small rotation vector [rad]."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    k: Array = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = (1.0, 0.5) if angle < 1e-9 else (math.sin(angle) / angle, (1 - math.cos(angle)) / angle**2)
    rotation: Array = np.eye(3) + sine * k + cosine * (k @ k)
    return rotation

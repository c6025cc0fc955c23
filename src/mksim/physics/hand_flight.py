"""Flying by hand: the programs of the simulated pilot.

A person who knows his aircraft tilts it, feels the tilt and corrects; the law below is that skill: a cascade of
position, speed and tilt that asks the attitude loop for a tilt rate (docs/lab/simulator.md, attitude loop). It reads
the truth because the pilot stands beside the aircraft; nothing that flies for the daemon can.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Final, Self

from mksim.physics.airframe import GRAVITY
from mksim.physics.attitude_loop import AxisLoop
from mksim.physics.pilot import RC_PERIOD, STICK_LIMIT, FlightView, SimulatedPilot

_POSITION_GAIN: Final = 1.0
_SPEED_GAIN: Final = 1.7
_TILT_GAIN: Final = 5.0
_MAX_SPEED: Final = 1.5
_MAX_TILT: Final = math.radians(14.0)
_MAX_TILT_RATE: Final = 1.2
_CLIMB_GAIN: Final = 20.0
_CLIMB_INTEGRAL: Final = 30.0
_GAS_START: Final = -40.0
_GESTURE: Final = 1.4
_PAUSE: Final = 0.6
_CLIMB: Final = 0.6
_SINK: Final = 0.45
_SINK_LOW: Final = 0.25


class HandPhase(StrEnum):
    """What the pilot is doing."""

    CALIBRATE = "calibrate"
    ARM = "arm"
    CLIMB = "climb"
    FLY = "fly"
    LAND = "land"
    STOP = "stop"
    DONE = "done"


_DOING: Final = {
    HandPhase.CALIBRATE: "calibrates the sensors, then starts the motors",
    HandPhase.ARM: "starts the motors",
    HandPhase.CLIMB: "takes off by hand",
    HandPhase.FLY: "flies by hand",
    HandPhase.LAND: "lands by hand",
    HandPhase.STOP: "stops the motors",
    HandPhase.DONE: "has stopped the motors",
}


def lean(
    view: FlightView, away: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Pitch and roll that fly towards a point [stick; FLU]; also what the simulated NaviCtrl asks for.

    Args:
        view: of the aircraft.
        away: how far east and north of it the point is [m].
        velocity: of the point [m/s].
    """
    airframe = view.airframe
    east = _acceleration(away[0], velocity[0], airframe.v_east)
    north = _acceleration(away[1], velocity[1], airframe.v_north)
    yaw = airframe.yaw
    forward = math.cos(yaw) * east + math.sin(yaw) * north
    left = math.cos(yaw) * north - math.sin(yaw) * east
    pitch = _stick(view, view.pitch, forward / GRAVITY, airframe.pitch)
    return pitch, _stick(view, view.roll, -left / GRAVITY, airframe.roll)


def _acceleration(away: float, velocity: float, speed: float) -> float:
    """Acceleration towards a moving point on one axis [m/s2]."""
    wanted = max(-_MAX_SPEED, min(_MAX_SPEED, _POSITION_GAIN * away)) + velocity
    return _SPEED_GAIN * (wanted - speed)


def _stick(view: FlightView, loop: AxisLoop, tilt: float, true_tilt: float) -> float:
    """Stick [count] that turns the true tilt towards the wanted one: the loop's equation, solved for its input."""
    gains = view.gains
    wanted = max(-_MAX_TILT, min(_MAX_TILT, tilt))
    rate = max(-_MAX_TILT_RATE, min(_MAX_TILT_RATE, _TILT_GAIN * (wanted - true_tilt)))
    angle = loop.believed + (rate + gains.a2 * loop.integral) / gains.a1
    return angle / gains.rad_per_count


class StickLaw:
    """Sticks towards a position, speed and climb rate."""

    def __init__(self, gas: float) -> None:
        self._gas = gas

    def move(
        self,
        pilot: SimulatedPilot,
        view: FlightView,
        position: tuple[float, float],
        velocity: tuple[float, float],
        climb: float,
    ) -> None:
        """Set the sticks for one receiver frame.

        Args:
            pilot: whose sticks.
            view: what he sees.
            position: east, north [m].
            velocity: of that point [m/s].
            climb: wanted climb rate [m/s].
        """
        airframe = view.airframe
        away = (position[0] - airframe.east, position[1] - airframe.north)
        pitch, roll = lean(view, away, velocity)
        error = climb - airframe.v_up
        self._gas = max(-STICK_LIMIT, min(STICK_LIMIT, self._gas + _CLIMB_INTEGRAL * error * RC_PERIOD))
        if airframe.on_ground or pilot.leaves_place_to_board:
            pitch = roll = 0.0
        pilot.set_sticks(pitch=pitch, roll=-roll, gas=self._gas + _CLIMB_GAIN * error)


class HandFlight:
    """Arm, take off, follow a path, land, stop the motors: all by RC sticks.

    Attributes:
        phase: what is being done.
    """

    def __init__(self, *, height: float = 2.0, hold_time: float = math.inf, flying: bool = False) -> None:
        """Plan a flight.

        Args:
            height: to fly at, feet above the start [m].
            hold_time: time to follow the path before landing [s].
            flying: begin in the air, in the middle of it.
        """
        self._height = height
        self._hold_time = hold_time
        self._has_started = False
        self._phase_since = 0.0
        self._anchor: tuple[float, float, float] | None = None
        self._law = StickLaw(0.0 if flying else _GAS_START)
        self._armed = HandPhase.CLIMB
        self.phase = HandPhase.FLY if flying else HandPhase.CALIBRATE

    @classmethod
    def starting(cls) -> Self:
        """Return a flight that ends on the ground, with the motors running."""
        flight = cls()
        flight._armed = HandPhase.DONE
        return flight

    @classmethod
    def stopping(cls) -> Self:
        """Return a flight that is over: on the ground, the motors to be stopped."""
        flight = cls()
        flight.phase = HandPhase.STOP
        return flight

    @property
    def doing(self) -> str:
        """What the pilot does; see `Program`."""
        has_started = self.phase is HandPhase.DONE and not self.is_over
        return "has started the motors, throttle at its lowest" if has_started else _DOING[self.phase]

    @property
    def is_over(self) -> bool:
        """The motors are stopped; see `Program`."""
        return self.phase is HandPhase.DONE and self._armed is not HandPhase.DONE

    def path(self, t: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return place and velocity relative to the start, east and north [m, m/s], `t` [s] after reaching height."""
        del t
        return (0.0, 0.0), (0.0, 0.0)

    def land(self) -> None:
        """Land from here, whatever the path says."""
        if self.phase in (HandPhase.CLIMB, HandPhase.FLY):
            self._anchor = None
            self.phase = HandPhase.LAND

    def fly(self, pilot: SimulatedPilot, view: FlightView, now: float) -> None:
        """Move the sticks."""
        if not self._has_started:
            self._has_started, self._phase_since = True, now
        if self._anchor is None:
            airframe = view.airframe
            ground = airframe.up - self._height if self.phase is HandPhase.FLY else airframe.up
            self._anchor = (airframe.east, airframe.north, ground)
        if self.phase in (HandPhase.CALIBRATE, HandPhase.ARM, HandPhase.STOP):
            self._gesture(pilot, view, now)
        elif self.phase is not HandPhase.DONE:
            self._fly_phase(pilot, view, now)

    def _gesture(self, pilot: SimulatedPilot, view: FlightView, now: float) -> None:
        """Hold the stick corner of this phase, then centre the sticks for a moment."""
        held = now - self._phase_since
        full = STICK_LIMIT
        if self.phase is HandPhase.CALIBRATE:
            if held < _GESTURE:
                pilot.set_sticks(yaw=full, gas=full)
            elif held < _GESTURE + _PAUSE:
                pilot.set_sticks(gas=-full)
            else:
                self._enter(HandPhase.ARM, now)
            return
        running = view.motors_running
        if running is (self.phase is HandPhase.ARM):
            pilot.set_sticks(gas=-full)
            if held >= _GESTURE + _PAUSE:
                self._enter(self._armed if self.phase is HandPhase.ARM else HandPhase.DONE, now)
        elif held < 2.0 * _GESTURE:
            yaw = -full if self.phase is HandPhase.ARM else full
            pilot.set_sticks(pitch=-full, roll=full, yaw=yaw, gas=-full)
        else:
            pilot.set_sticks(gas=-full)
            if held >= 2.0 * _GESTURE + _PAUSE:
                self._phase_since = now  # the board missed it: once more

    def _fly_phase(self, pilot: SimulatedPilot, view: FlightView, now: float) -> None:
        airframe = view.airframe
        assert self._anchor is not None
        east, north, ground = self._anchor
        height = airframe.up - ground
        if self.phase is HandPhase.LAND:
            surface = airframe.ground.at(airframe.east, airframe.north, now)[0]
            sink = _SINK_LOW if airframe.up - surface < 0.8 else _SINK
            self._law.move(pilot, view, (east, north), (0.0, 0.0), -sink)
            if airframe.on_ground:
                pilot.set_sticks(gas=-STICK_LIMIT)
                self._enter(HandPhase.STOP, now)
            return
        (d_east, d_north), velocity = (0.0, 0.0), (0.0, 0.0)
        if self.phase is HandPhase.FLY:
            (d_east, d_north), velocity = self.path(now - self._phase_since)
            if view.battery.is_low or now - self._phase_since > self._hold_time:
                self.land()
                return
        elif height > self._height - 0.15:
            self._enter(HandPhase.FLY, now)
        climb = max(-_SINK, min(_CLIMB, 1.2 * (self._height - height)))
        self._law.move(pilot, view, (east + d_east, north + d_north), velocity, climb)

    def _enter(self, phase: HandPhase, now: float) -> None:
        self.phase, self._phase_since = phase, now


class CircleFlight(HandFlight):
    """A slow safe circle until the battery is low: what an unattended simulator shows."""

    def __init__(self, *, radius: float = 1.5, period: float = 20.0, height: float = 2.0) -> None:
        """Plan it.

        Args:
            radius: [m].
            period: of one round [s].
            height: feet above the start [m].
        """
        super().__init__(height=height)
        self._radius = radius
        self._omega = 2.0 * math.pi / period

    def path(self, t: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return a point on the circle that begins at the start point; the speed builds up in four seconds."""
        ramp = 4.0
        phase, rate = (0.5 * t * t / ramp, t / ramp) if t < ramp else (t - 0.5 * ramp, 1.0)
        angle, speed = self._omega * phase, self._omega * rate * self._radius
        return (
            (self._radius * (math.cos(angle) - 1.0), self._radius * math.sin(angle)),
            (-speed * math.sin(angle), speed * math.cos(angle)),
        )

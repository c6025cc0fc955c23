"""An aircraft that stands still on the bench, where only the boards matter: no physics to pay for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from mksim.faults import RunningFaults
from mksim.physics.attitude_loop import AttitudeGains
from mksim.physics.sensors import GpsReport
from mksim.physics.world import DT, StickInput

TILT_LAG = 0.25
"""With which the tilt follows the sticks [s]; docs/control.md, "The attitude loop"."""
RAD_PER_COUNT = math.radians(0.451)
"""Tilt of a stick count with the factory's set Easy [rad]."""
FIX = GpsReport(530712345, 87912345, 12.0, (0.0, 0.0, 0.0), 9, True, 0.0, 1)


@dataclass
class Readings:
    """What its sensors say: level, motors off, a full battery, a fix. Units are those of the simulated sensors."""

    acc_x: float = 0.0
    acc_y: float = 0.0
    acc_z: float = 9.81
    gyro_z: float = 0.0
    fc_angle_pitch: float = 0.0
    fc_angle_roll: float = 0.0
    heading_deg: float = 0.0
    compass_deg: float = 0.0
    baro_height: float = 0.0
    vertical_speed: float = 0.0
    gps: GpsReport = FIX
    battery_voltage: float = 12.5
    battery_current: float = 0.4
    battery_used_mah: float = 0.0
    motor_setpoints: list[int] = field(default_factory=lambda: [0] * 12)


@dataclass
class Transmitter:
    """A transmitter that is switched on, sticks at rest, gate closed."""

    pitch: int = 0
    roll: int = 0
    yaw: int = 0
    gas: int = -127
    gate: int = 0
    rc_quality: int = 200
    switches: dict[int, int] = field(default_factory=dict)


class GroundedAircraft:
    """Does not fly.

    Attributes:
        now: virtual time [s].
        gains: the FlightCtrl's attitude gains, as it set them last.
        calibrations: how often it was zeroed.
    """

    def __init__(self, sensors: Readings | None = None, pilot: Transmitter | None = None) -> None:
        self.now = 0.0
        self.faults = RunningFaults()
        self.sensors = sensors or Readings()
        self.pilot = pilot or Transmitter()
        self.gains: AttitudeGains | None = None
        self.calibrations = 0
        self._steps = 0

    def step(self, sticks: StickInput) -> None:
        """Let one period of the control loop pass."""
        self._steps += 1
        self.now = self._steps * DT
        self.faults.advance(self.now)

    def lean(self, pitch: float, roll: float, seconds: float) -> None:
        """Answer sticks for a time [s], as an aircraft does that can tilt freely: towards the tilt that they ask for.

        Args:
            pitch: nose down positive [stick].
            roll: right side down positive [stick].
            seconds: since the last call [s].
        """
        sensors, share = self.sensors, 1.0 - math.exp(-seconds / TILT_LAG)
        per_count = RAD_PER_COUNT if self.gains is None else self.gains.rad_per_count
        sensors.fc_angle_pitch += (pitch * per_count - sensors.fc_angle_pitch) * share
        sensors.fc_angle_roll += (roll * per_count - sensors.fc_angle_roll) * share

    def steer(self, away: tuple[float, float] | None) -> None:
        """Lean nowhere: it stands."""

    def calibrate(self) -> None:
        """Zero the sensors, which show no error."""
        self.calibrations += 1

    def set_attitude_gains(self, gains: AttitudeGains) -> None:
        """Take gains; there is no attitude loop."""
        self.gains = gains

"""An aircraft that stands still on the bench, for campaigns in which only the boards matter: no physics to pay for."""

from __future__ import annotations

from mkdaemon.sim.faults import Faults
from mkdaemon.sim.physics.attitude_loop import AttitudeGains
from mkdaemon.sim.physics.sensors import GpsFix
from mkdaemon.sim.physics.world import DT, StickInput


class _Values:
    """Constant readings: level, motors off, a full battery, a fix."""

    def __init__(self) -> None:
        self.acc_x = self.acc_y = 0.0
        self.acc_z = 9.81
        self.gyro_z = 0.0
        self.fc_angle_pitch = self.fc_angle_roll = 0.0
        self.heading_deg = self.compass_deg = 0.0
        self.baro_height = self.vertical_speed = 0.0
        self.gps = GpsFix(530712345, 87912345, 12.0, (0.0, 0.0, 0.0), 9, True, 0.0, 1)
        self.battery_voltage, self.battery_current, self.battery_used_mah = 12.5, 0.4, 0.0
        self.motor_setpoints = [0] * 12


class _Hands:
    """A transmitter that is switched on, sticks at rest, gate closed."""

    pitch = roll = yaw = 0
    gas = -127
    gate = 0
    rc_quality = 200

    def __init__(self) -> None:
        self.switches: dict[int, int] = {}


class GroundedAircraft:
    """Stands still."""

    def __init__(self) -> None:
        self.now = 0.0
        self.faults = Faults()
        self.sensors = _Values()
        self.pilot = _Hands()
        self._steps = 0

    def step(self, sticks: StickInput) -> None:
        """Let one period of the control loop pass."""
        self._steps += 1
        self.now = self._steps * DT

    def calibrate(self) -> None:
        """Nothing to zero."""

    def set_attitude_gains(self, gains: AttitudeGains) -> None:
        """No attitude loop."""

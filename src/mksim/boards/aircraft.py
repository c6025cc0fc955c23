"""What the boards need of the aircraft they fly; `mksim.physics.world.World` is one."""

from __future__ import annotations

from typing import Protocol

from mksim.faults import RunningFaults
from mksim.physics.attitude_loop import AttitudeGains
from mksim.physics.sensors import GpsReport
from mksim.physics.world import StickInput


class Readings(Protocol):
    """What the boards read; attributes as `mksim.physics.sensors.Sensors` documents them."""

    acc_x: float
    acc_y: float
    acc_z: float
    gyro_z: float
    fc_angle_pitch: float
    fc_angle_roll: float
    heading_deg: float
    compass_deg: float
    baro_height: float
    vertical_speed: float
    gps: GpsReport
    battery_voltage: float
    battery_current: float
    battery_used_mah: float
    motor_setpoints: list[int]


class Transmitter(Protocol):
    """The pilot's channels on the firmware's axes; attributes as of `mksim.physics.pilot.SimulatedPilot`."""

    pitch: int
    roll: int
    yaw: int
    gas: int
    switches: dict[int, int]

    @property
    def gate(self) -> int:
        """The external-control switch, 0..255."""

    @property
    def rc_quality(self) -> int:
        """Reception, 0..200."""


class SimulatedAircraft(Protocol):
    """Everything under the boards: airframe, sensors, receiver, faults."""

    now: float
    faults: RunningFaults

    @property
    def sensors(self) -> Readings:
        """The sensors' present values."""

    @property
    def pilot(self) -> Transmitter:
        """What the receiver delivers now."""

    def step(self, sticks: StickInput) -> None:
        """Fly on for one period of the control loop."""

    def steer(self, away: tuple[float, float] | None) -> None:
        """Lean towards a place, metres east and north, as the NaviCtrl commands; None without a command."""

    def calibrate(self) -> None:
        """Zero the FlightCtrl's angles."""

    def set_attitude_gains(self, gains: AttitudeGains) -> None:
        """Fly on with another parameter set."""

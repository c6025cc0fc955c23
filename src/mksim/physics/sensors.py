"""What the boards see of the flight: noisy, biased, stepped. SI, body FLU, world ENU, headings clockwise from north."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Final

from mkdaemon.frames import geodetic_from_enu
from mksim.config import FlightConfig
from mksim.physics.airframe import GRAVITY, Airframe
from mksim.physics.battery import SimulatedBattery

GPS_PERIOD: Final = 0.2
"""The receiver reports five times a second."""
_GPS_CORRELATION: Final = 60.0
_BARO_CORRELATION: Final = 10.0
_ACC_RANGE: Final = 2.5 * GRAVITY
_VARIO_LAG: Final = 0.3
_GPS_SPEED_NOISE: Final = 0.1
_ALTITUDE_FACTOR: Final = 1.5
"""Vertical over horizontal GPS error (usual ratio of VDOP to HDOP)."""


@dataclass(frozen=True, slots=True)
class GpsReport:
    """One report of the GPS receiver.

    Attributes:
        latitude_1e7: [1e-7 deg].
        longitude_1e7: [1e-7 deg].
        altitude: above the ellipsoid [m].
        velocity_enu: [m/s].
        satellites: used.
        has_fix: a 3-D fix.
        at: when it was measured, simulated time [s].
        sequence: counts reports.
    """

    latitude_1e7: int
    longitude_1e7: int
    altitude: float
    velocity_enu: tuple[float, float, float]
    satellites: int
    has_fix: bool
    at: float
    sequence: int


class Sensors:
    """Gyros and accelerometers at every step, the rest at their own pace.

    Attributes:
        gyro_x: roll rate, right side down positive [rad/s].
        gyro_y: pitch rate, nose down positive [rad/s].
        gyro_z: yaw rate, nose left positive [rad/s].
        acc_x: specific force forward [m/s2].
        acc_y: specific force left [m/s2].
        acc_z: specific force up [m/s2].
        fc_angle_pitch: pitch as the FlightCtrl reports it, nose down positive [rad].
        fc_angle_roll: roll as the FlightCtrl reports it, right side down positive [rad].
        heading_deg: fused heading, clockwise from north [deg], 0..360.
        compass_deg: raw compass heading [deg], 0..360.
        baro_height: height above the start [m].
        vertical_speed: variometer, up positive [m/s].
        gps: last report.
        battery_voltage: [V].
        battery_current: [A].
        battery_used_mah: [mAh].
        motor_setpoints: [count], twelve entries.
    """

    __slots__ = (
        "_acc_noise",
        "_baro_keep",
        "_baro_kick",
        "_baro_step",
        "_baro_wander",
        "_compass_bias",
        "_compass_noise",
        "_config",
        "_gps_kick",
        "_gps_noise",
        "_gps_wander",
        "_gyro_bias",
        "_gyro_noise",
        "_mount_pitch",
        "_mount_roll",
        "_next_gps",
        "_origin",
        "_period",
        "_rng",
        "_start_height",
        "_vario",
        "acc_x",
        "acc_y",
        "acc_z",
        "baro_height",
        "battery_current",
        "battery_used_mah",
        "battery_voltage",
        "compass_deg",
        "compass_fault_deg",
        "compass_yaw",
        "fc_angle_pitch",
        "fc_angle_roll",
        "gps",
        "gps_lost",
        "gyro_fault",
        "gyro_x",
        "gyro_y",
        "gyro_z",
        "heading_deg",
        "lean_fault",
        "motor_setpoints",
        "vertical_speed",
    )

    def __init__(self, config: FlightConfig, *, rng: random.Random, slow_period: float, airframe: Airframe) -> None:
        """Draw the biases.

        Args:
            config: ranges.
            rng: owned by the sensors alone.
            slow_period: time between two calls of `update_slow` [s].
            airframe: where the aircraft starts.
        """
        sensors = config.sensors
        self._config = sensors
        self._rng = rng
        self._period = slow_period
        self._gyro_noise = math.radians(sensors.gyro_noise_deg)
        self._acc_noise = sensors.acc_noise
        bias = math.radians(sensors.gyro_bias_deg)
        self._gyro_bias = (rng.uniform(-bias, bias), rng.uniform(-bias, bias), rng.uniform(-bias, bias))
        mount, toward = math.radians(rng.uniform(0.0, sensors.acc_mount_deg)), rng.uniform(0.0, 2.0 * math.pi)
        self._mount_pitch, self._mount_roll = mount * math.cos(toward), mount * math.sin(toward)
        self._compass_bias = math.radians(rng.uniform(-sensors.compass_bias_deg, sensors.compass_bias_deg))
        self._compass_noise = math.radians(sensors.compass_noise_deg)
        self._baro_keep = math.exp(-slow_period / _BARO_CORRELATION)
        self._baro_kick = sensors.baro_noise * math.sqrt(1.0 - self._baro_keep**2)
        self._baro_step = sensors.baro_step
        self._baro_wander = 0.0  # the boards zero the barometer when they calibrate
        self._gps_noise = sensors.gps_noise
        self._gps_wander = [rng.gauss(0.0, sensors.gps_wander) for _ in range(3)]
        # The slow error is a Gauss-Markov process, as of the wind; white noise is added to it.
        keep = math.exp(-GPS_PERIOD / _GPS_CORRELATION)
        self._gps_kick = sensors.gps_wander * math.sqrt(1.0 - keep * keep)
        self._origin = (
            math.radians(config.origin_latitude_deg),
            math.radians(config.origin_longitude_deg),
            config.origin_altitude,
        )
        self._next_gps = 0.0
        self._start_height = airframe.up
        self._vario = 0.0
        self.gps_lost = False
        self.compass_fault_deg = 0.0
        self.gyro_fault = self.lean_fault = 0.0
        self.gyro_x = self.gyro_y = self.gyro_z = 0.0
        self.acc_x, self.acc_y, self.acc_z = 0.0, 0.0, GRAVITY
        self.fc_angle_pitch = self.fc_angle_roll = 0.0
        self.heading_deg = self.compass_deg = 0.0
        self.compass_yaw = airframe.yaw
        self.baro_height = self.vertical_speed = 0.0
        self.battery_voltage = self.battery_current = self.battery_used_mah = 0.0
        self.motor_setpoints: list[int] = []
        self.gps = GpsReport(0, 0, 0.0, (0.0, 0.0, 0.0), 0, False, 0.0, 0)

    def update_inertial(self, airframe: Airframe) -> None:
        """Measure rates and specific forces; called at every step."""
        gauss, noise, bias = self._rng.gauss, self._gyro_noise, self._gyro_bias
        fault = self.gyro_fault
        self.gyro_x = airframe.rate_x + bias[0] + fault + gauss(0.0, noise)
        self.gyro_y = airframe.rate_y + bias[1] + fault + gauss(0.0, noise)
        self.gyro_z = airframe.rate_z + bias[2] + gauss(0.0, noise)
        noise = self._acc_noise
        force_z = airframe.force_z
        # a tilted sensor reads a part of the vertical as horizontal: that is how a mount error enters
        acc_x = airframe.force_x - (self._mount_pitch + self.lean_fault) * force_z + gauss(0.0, noise)
        acc_y = airframe.force_y + (self._mount_roll + self.lean_fault) * force_z + gauss(0.0, noise)
        self.acc_x = max(-_ACC_RANGE, min(_ACC_RANGE, acc_x))
        self.acc_y = max(-_ACC_RANGE, min(_ACC_RANGE, acc_y))
        self.acc_z = max(-_ACC_RANGE, min(_ACC_RANGE, force_z))

    def update_slow(self, airframe: Airframe, battery: SimulatedBattery, now: float) -> None:
        """Measure barometer, compass, battery and, when due, GPS; called every `slow_period`."""
        gauss = self._rng.gauss
        self._baro_wander = self._baro_wander * self._baro_keep + gauss(0.0, self._baro_kick)
        height = airframe.up - self._start_height + self._baro_wander
        self.baro_height = round(height / self._baro_step) * self._baro_step if self._baro_step else height
        self._vario += (airframe.v_up - self._vario) * min(1.0, self._period / _VARIO_LAG)
        self.vertical_speed = self._vario
        error = self._compass_bias + math.radians(self.compass_fault_deg) + gauss(0.0, self._compass_noise)
        self.compass_yaw = airframe.yaw - error
        self.compass_deg = math.degrees(math.pi / 2.0 - self.compass_yaw) % 360.0
        self.battery_voltage = battery.voltage + gauss(0.0, self._config.voltage_noise)
        self.battery_current = battery.current
        self.battery_used_mah = battery.used_mah
        if now >= self._next_gps:
            self._next_gps += GPS_PERIOD
            self._update_gps(airframe, now)

    def report(self, believed_pitch: float, believed_roll: float, heading: float, setpoints: list[int]) -> None:
        """Take over what the FlightCtrl knows about itself: angles [rad], heading [rad; ENU yaw], set points."""
        scale = self._config.fc_angle_scale
        self.fc_angle_pitch = believed_pitch * scale
        self.fc_angle_roll = believed_roll * scale
        self.heading_deg = math.degrees(math.pi / 2.0 - heading) % 360.0
        self.motor_setpoints = setpoints

    def _update_gps(self, airframe: Airframe, now: float) -> None:
        gauss, noise = self._rng.gauss, self._gps_noise
        # The slow error is a Gauss-Markov process, as of the wind; white noise is added to it.
        keep = math.exp(-GPS_PERIOD / _GPS_CORRELATION)
        self._gps_wander = [value * keep + gauss(0.0, self._gps_kick) for value in self._gps_wander]
        drawn = (gauss(0.0, noise), gauss(0.0, noise), gauss(0.0, noise), *(gauss(0.0, 1.0) for _ in range(3)))
        sequence = self.gps.sequence + 1
        if self.gps_lost:
            last = self.gps
            self.gps = GpsReport(
                last.latitude_1e7, last.longitude_1e7, last.altitude, (0.0, 0.0, 0.0), 0, False, now, sequence
            )
            return
        latitude, longitude, altitude = geodetic_from_enu(
            airframe.east + self._gps_wander[0] + drawn[0],
            airframe.north + self._gps_wander[1] + drawn[1],
            airframe.up + _ALTITUDE_FACTOR * (self._gps_wander[2] + drawn[2]),
            self._origin,
        )
        speed_noise = _GPS_SPEED_NOISE if noise else 0.0
        self.gps = GpsReport(
            latitude_1e7=round(math.degrees(latitude) * 1e7),
            longitude_1e7=round(math.degrees(longitude) * 1e7),
            altitude=altitude,
            velocity_enu=(
                airframe.v_east + speed_noise * drawn[3],
                airframe.v_north + speed_noise * drawn[4],
                airframe.v_up + speed_noise * drawn[5],
            ),
            satellites=9,
            has_fix=True,
            at=now,
            sequence=sequence,
        )

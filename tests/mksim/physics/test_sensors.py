"""Sensors by their signs and faults."""

from __future__ import annotations

import math
import random

import pytest

from mkdaemon.frames import enu_from_geodetic
from mksim.config import FlightConfig, SensorConfig
from mksim.physics.airframe import GRAVITY, Airframe, FlatGround
from mksim.physics.battery import SimulatedBattery
from mksim.physics.sensors import Sensors

PERIOD = 0.02048
NOISY = FlightConfig()
IDEAL = FlightConfig(sensors=SensorConfig.ideal())


def standing(yaw: float = math.pi / 2) -> Airframe:
    airframe = Airframe(FlightConfig().airframe, FlatGround())
    airframe.place(0.0, 0.0, 0.0, yaw)
    return airframe


def sensors_of(config: FlightConfig, airframe: Airframe, seed: int = 1) -> Sensors:
    return Sensors(config, rng=random.Random(seed), slow_period=PERIOD, airframe=airframe)


def enu_of(config: FlightConfig, sensors: Sensors) -> tuple[float, float, float]:
    origin = (
        math.radians(config.origin_latitude_deg),
        math.radians(config.origin_longitude_deg),
        config.origin_altitude,
    )
    gps = sensors.gps
    return enu_from_geodetic(
        math.radians(gps.latitude_1e7 / 1e7), math.radians(gps.longitude_1e7 / 1e7), gps.altitude, origin
    )


def test_ideal_sensors_tell_the_truth() -> None:
    airframe, battery = standing(), SimulatedBattery(IDEAL.battery)
    sensors = sensors_of(IDEAL, airframe)
    airframe.east, airframe.north, airframe.up = 3.0, -4.0, 10.1
    airframe.rate_x, airframe.rate_y, airframe.rate_z = 0.1, -0.2, 0.3
    sensors.update_inertial(airframe)
    sensors.update_slow(airframe, battery, 0.0)
    assert (sensors.gyro_x, sensors.gyro_y, sensors.gyro_z) == (0.1, -0.2, 0.3)
    assert (sensors.acc_x, sensors.acc_y, sensors.acc_z) == (0.0, 0.0, GRAVITY)
    assert sensors.baro_height == pytest.approx(10.0)
    assert sensors.battery_voltage == battery.voltage
    assert enu_of(IDEAL, sensors) == pytest.approx((3.0, -4.0, 10.1), abs=0.02)


@pytest.mark.parametrize(("yaw_deg", "heading_deg"), [(90.0, 0.0), (0.0, 90.0), (180.0, 270.0), (-90.0, 180.0)])
def test_headings_run_clockwise_from_north_and_a_fault_turns_the_compass(yaw_deg: float, heading_deg: float) -> None:
    airframe = standing(math.radians(yaw_deg))
    sensors = sensors_of(IDEAL, airframe)
    for fault in (0.0, 30.0):
        sensors.compass_fault_deg = fault
        sensors.update_slow(airframe, SimulatedBattery(IDEAL.battery), 0.0)
        sensors.report(0.0, 0.0, math.radians(yaw_deg), [0] * 12)
        assert math.remainder(sensors.compass_deg - heading_deg - fault, 360.0) == pytest.approx(0.0, abs=1e-9)
        assert math.remainder(sensors.heading_deg - heading_deg, 360.0) == pytest.approx(0.0, abs=1e-9)


def test_lost_gps_says_so_and_keeps_reporting() -> None:
    airframe, battery = standing(), SimulatedBattery(NOISY.battery)
    sensors = sensors_of(NOISY, airframe)
    sensors.update_slow(airframe, battery, 0.0)
    last = sensors.gps
    sensors.gps_lost = True
    sensors.update_slow(airframe, battery, 0.2)
    assert (sensors.gps.has_fix, sensors.gps.satellites) == (False, 0)
    assert sensors.gps.latitude_1e7 == last.latitude_1e7
    assert sensors.gps.sequence == last.sequence + 1

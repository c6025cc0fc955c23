"""Sensors by their statistics and signs."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

import numpy as np
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


def watched(seed: int, seconds: float, yaw: float = math.pi / 2) -> Iterator[Sensors]:
    """Noisy sensors of an aircraft that stands, after each of their slow readings."""
    airframe, battery = standing(yaw), SimulatedBattery(NOISY.battery)
    sensors = sensors_of(NOISY, airframe, seed)
    for k in range(round(seconds / PERIOD)):
        sensors.update_slow(airframe, battery, k * PERIOD)
        yield sensors


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


def test_compass_has_a_bias_per_seed_and_noise() -> None:
    headings = np.array(
        [[s.compass_deg - 180.0 for s in watched(seed, 100 * PERIOD, -math.pi / 2)] for seed in range(40)]
    )
    biases = headings.mean(axis=1)
    assert np.abs(biases).max() < 5.7
    assert np.std(biases) == pytest.approx(5.0 / math.sqrt(3.0), rel=0.3)
    assert headings.std(axis=1).mean() == pytest.approx(1.5, rel=0.1)


def test_baro_wanders_by_15_cm_in_steps_of_5() -> None:
    heights = [list(watched(seed, 1500 * PERIOD))[-1].baro_height for seed in range(60)]
    assert [math.remainder(height, 0.05) for height in heights] == pytest.approx([0.0] * 60, abs=1e-9)
    assert np.std(heights) == pytest.approx(0.15, rel=0.3)


def test_gps_reports_at_5_hz_within_two_or_three_metres() -> None:
    last = [list(watched(seed, 4.0))[-1] for seed in range(60)]
    assert {(sensors.gps.sequence, sensors.gps.has_fix) for sensors in last} == {(20, True)}
    errors = [math.hypot(*enu_of(NOISY, sensors)[:2]) for sensors in last]
    assert math.sqrt(np.mean(np.square(errors))) == pytest.approx(2.2, rel=0.25)


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


def test_mount_error_leans_the_accelerometer_by_up_to_a_degree_and_a_half() -> None:
    leans = []
    for seed in range(100):
        airframe = standing()
        sensors = sensors_of(FlightConfig(sensors=SensorConfig(acc_noise=0.0)), airframe, seed)
        sensors.update_inertial(airframe)
        leans.append(math.degrees(math.hypot(sensors.acc_x, sensors.acc_y) / GRAVITY))
    assert 1.2 < max(leans) <= 1.5
    assert np.mean(leans) == pytest.approx(0.75, rel=0.2)


def test_gyro_and_accelerometer_noise() -> None:
    airframe = standing()
    sensors = sensors_of(NOISY, airframe)
    rows = []
    for _ in range(5000):
        sensors.update_inertial(airframe)
        rows.append((sensors.gyro_x, sensors.gyro_y, sensors.gyro_z, sensors.acc_x, sensors.acc_y))
    spread = np.std(rows, axis=0)
    assert np.degrees(spread[:3]) == pytest.approx([0.3] * 3, rel=0.1)
    assert spread[3:] == pytest.approx([0.15] * 2, rel=0.1)
    assert np.abs(np.degrees(np.mean(rows, axis=0)[:3])).max() < 0.12


def test_accelerometers_saturate() -> None:
    airframe = standing()
    airframe.force_x, airframe.force_z = 100.0, -100.0
    sensors = sensors_of(IDEAL, airframe)
    sensors.update_inertial(airframe)
    assert sensors.acc_x == 2.5 * GRAVITY
    assert sensors.acc_z == -2.5 * GRAVITY


@pytest.mark.parametrize("scale", [0.89, 1.0, 1.13])
def test_reported_angle_is_scaled(scale: float) -> None:
    config = FlightConfig(sensors=SensorConfig(fc_angle_scale=scale))
    sensors = sensors_of(config, standing())
    sensors.report(0.1, -0.2, 0.0, [0] * 12)
    assert (sensors.fc_angle_pitch, sensors.fc_angle_roll) == pytest.approx((0.1 * scale, -0.2 * scale))

"""The attitude loop against the figures of the aircraft and of the genuine firmware."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache

import pytest

from mksim.config import AirframeConfig, FlightConfig, LoopConfig, SensorConfig, WindClass
from mksim.physics.attitude_loop import (
    AGILE,
    EASY,
    FAST,
    LEAK_FAST,
    LEAK_SLOW,
    AttitudeGains,
    AxisLoop,
    YawLoop,
)
from mksim.physics.pilot import RC_PERIOD
from mksim.physics.world import DT, StartState, StickInput, World

SETS = {"easy": EASY, "agile": AGILE, "fast": FAST}
STEP_DEG = 8.0


def gains_of(name: str, *, stick_filter: bool = True, ta: float = LEAK_FAST) -> AttitudeGains:
    return AttitudeGains.from_parameters(**SETS[name], stick_filter=stick_filter, ta=ta)


@pytest.mark.parametrize(
    ("name", "deg_per_count", "a1", "a2"),
    [("easy", 0.451, 3.10, 3.33), ("agile", 0.601, 3.10, 3.33), ("fast", 0.751, 3.41, 7.1)],
)
def test_gains_of_the_parameter_sets(name: str, deg_per_count: float, a1: float, a2: float) -> None:
    gains = gains_of(name)
    assert math.degrees(gains.rad_per_count) == pytest.approx(deg_per_count, abs=0.0006)
    assert gains.a1 == pytest.approx(a1, rel=0.005)
    assert gains.a2 == pytest.approx(a2, rel=0.005)
    assert math.degrees(gains.yaw_linear) == pytest.approx(0.4)
    assert math.degrees(gains.yaw_square) == pytest.approx(0.0047 * 4 / 6)


@cache
def respond(
    name: str, *, stick_filter: bool = True, ta: float = LEAK_FAST, drag: float = 0.35, truncate: bool = False
) -> list[tuple[float, float, float]]:
    """Time, true pitch and believed pitch [deg] after a step of 8 deg in hover gas, without wind or noise."""
    gains = gains_of(name, stick_filter=stick_filter, ta=ta)
    config = FlightConfig(
        wind=WindClass.NONE,
        sensors=SensorConfig.ideal(),
        airframe=AirframeConfig(drag=drag),
        loop=LoopConfig(truncate_sticks=truncate),
    )
    world = World(config, seed=1, start=StartState(height=60.0), gains=gains)
    for _ in range(100):
        world.step(StickInput(0.0, 0.0, 0.0, 125.0, motors_running=True))
    began, stick = world.now, math.radians(STEP_DEG) / gains.rad_per_count
    trace = []
    while world.now - began < 4.2:
        world.step(StickInput(stick, 0.0, 0.0, 125.0, motors_running=True))
        trace.append((world.now - began, math.degrees(world.truth.pitch), math.degrees(world.sensors.fc_angle_pitch)))
    return trace


def t63(trace: list[tuple[float, float, float]], column: int) -> float:
    return next(row[0] for row in trace if row[column] >= (1.0 - math.exp(-1.0)) * STEP_DEG)


def overshoot(trace: list[tuple[float, float, float]]) -> float:
    return max(believed for _, _, believed in trace) / STEP_DEG - 1.0


@pytest.mark.parametrize(("stick_filter", "measured"), [(True, 0.37), (False, 0.29)])
def test_easy_step_has_the_measured_rise(stick_filter: bool, measured: float) -> None:
    """0.37 s on 2.12, 0.29 s on the 2010 firmware."""
    assert t63(respond("easy", stick_filter=stick_filter), 1) == pytest.approx(measured, rel=0.1)
    assert t63(respond("easy", stick_filter=stick_filter, ta=LEAK_SLOW), 2) == pytest.approx(measured, rel=0.1)


@pytest.mark.parametrize("ta", [LEAK_FAST, LEAK_SLOW])
@pytest.mark.parametrize("stick_filter", [True, False])
def test_easy_step_has_the_measured_overshoot(stick_filter: bool, ta: float) -> None:
    assert 0.9 * 0.15 <= overshoot(respond("easy", stick_filter=stick_filter, ta=ta)) <= 1.1 * 0.19


GENUINE_TILT = {0.25: 3.4, 0.5: 7.4, 1.0: 12.8, 2.0: 19.3, 3.0: 22.2, 4.0: 21.4}
"""True tilt of the genuine firmware after a constant 18 counts, Easy set: seconds and degrees."""
GENUINE_BELIEVED = {0.25: 3.0, 0.5: 5.9, 1.0: 7.8, 2.0: 8.6, 4.0: 8.8}


def leaning(seed: int, **scale: float) -> list[tuple[float, float]]:
    """True and believed pitch [deg] of 4 s with a constant 18 counts, for a scale of the accelerometer."""
    sensors = SensorConfig.ideal().model_copy(update={"acc_scale_min": 0.79, **scale})
    world = World(FlightConfig(wind=WindClass.NONE, sensors=sensors), seed=seed, start=StartState(height=60.0))
    tilts = []
    for _ in range(round(4.0 / DT)):
        world.step(StickInput(18.0, 0.0, 0.0, 127.0, motors_running=True))
        tilts.append((math.degrees(world.truth.pitch), math.degrees(world.sensors.fc_angle_pitch)))
    return tilts


def test_a_constant_command_tilts_as_on_the_genuine_firmware_where_the_accelerometer_is_weakest() -> None:
    tilts = leaning(1, acc_scale_max=0.79)
    waited = RC_PERIOD / 2.0  # here the stick meets a receiver frame at once
    for column, genuine in enumerate((GENUINE_TILT, GENUINE_BELIEVED)):
        for when, tilt in genuine.items():
            assert tilts[round((when - waited) / DT) - 1][column] == pytest.approx(tilt, abs=0.15)


def test_the_stick_filter_takes_a_quarter_of_every_receiver_frame_in_whole_units() -> None:
    """FlightCtrl fc.c: stick = (3 stick + channel * Stick_P) / 4, Stick_P 6, truncated."""
    loop = AxisLoop(gains_of("easy"), LoopConfig())
    units = []
    for _ in range(5):
        loop.take_stick(11.0)
        units.append(round(loop.stick * 6.0, 9))
    assert units == [16, 28, 37, 44, 49]


COUNT_DEG = 1.0 / 1220.0 / DT
"""One count a loop [deg/s]."""


@pytest.mark.parametrize(
    ("leaned_deg", "counts"),
    [(0.34, 0), (-0.34, 0), (0.37, 1), (-0.37, -1), (0.70, 1), (0.72, 2), (1.79, 5), (40.0, 32), (-40.0, -32)],
)
def test_the_leak_is_a_whole_number_of_counts(leaned_deg: float, counts: int) -> None:
    """A sixteenth of the difference in counts of 27 to 1220 a degree, truncated: 0.354 deg a count, 32 at most."""
    loop = AxisLoop(gains_of("easy"), LoopConfig())
    for _ in range(40):
        before = loop.believed
        loop.update(0.0, math.radians(leaned_deg) + before, 0.0, flying=True)  # the filtered one comes up to it
    assert math.degrees(loop.believed - before) / DT == pytest.approx(counts * COUNT_DEG, abs=1e-9)


@pytest.mark.parametrize(("rate_deg", "counts"), [(0.39, 0), (-0.39, 0), (0.41, 1), (-0.81, -2), (10.2, 25)])
def test_the_gyro_is_integrated_in_whole_counts(rate_deg: float, counts: int) -> None:
    loop = AxisLoop(gains_of("easy"), LoopConfig())
    loop.update(math.radians(rate_deg), 0.0, 0.0, flying=True)
    assert math.degrees(loop.believed) / DT == pytest.approx(counts * COUNT_DEG, abs=1e-9)


def turning(loop: YawLoop, stick: float, seconds: float, yaw: float = 0.0) -> Iterator[tuple[float, float]]:
    """Rate [rad/s] and yaw [rad] of an aircraft that follows its rate loop exactly, pass by pass."""
    rate = 0.0
    for _ in range(round(seconds / DT)):
        loop.update(stick, rate, yaw, flying=True)
        rate += loop.acceleration * DT
        yaw += rate * DT
        yield rate, yaw


def turn(stick: float, *, lock: bool = True) -> list[float]:
    """Yaw [deg] of 20 s with a stick."""
    loop = YawLoop(AttitudeGains.from_parameters(), LoopConfig(compass_lock=lock), 0.0)
    return [math.degrees(yaw) for _, yaw in turning(loop, stick, 20.0)]


@pytest.mark.parametrize(
    ("stick", "rate_deg", "genuine_deg"),
    [
        *((0, 0, 0), (4, 0, 0), (8, 1.65, 1.5), (-8, -1.65, -1.5), (12, 3.4, 3.25)),
        *((20, 7.2, 7.5), (40, 18.46, 19.3), (-40, -18.46, -19.3)),
    ],
)
def test_yaw_is_a_rate_with_a_dead_band(stick: float, rate_deg: float, genuine_deg: float) -> None:
    """Beside the rates of the genuine firmware, Easy set."""
    yaws = turn(stick)
    rate = (yaws[round(4.0 / DT)] - yaws[round(2.0 / DT)]) / 2.0
    assert rate == pytest.approx(rate_deg, rel=0.01, abs=1e-9)
    assert rate == pytest.approx(genuine_deg, rel=0.1, abs=1e-9)


def test_a_yaw_step_overshoots_by_40_percent_and_settles_in_0_35_s() -> None:
    rates = [rate for rate, _ in turning(YawLoop(AttitudeGains.from_parameters(), LoopConfig(), 0.0), 40.0, 1.5)]
    share = [value / rates[-1] for value in rates]
    assert next(k for k, value in enumerate(share) if value >= 0.63) * DT == pytest.approx(0.08, abs=0.01)
    assert max(share) - 1.0 == pytest.approx(0.40, abs=0.04)
    assert max(k for k, value in enumerate(share) if abs(value - 1.0) > 0.05) * DT == pytest.approx(0.35, abs=0.04)


def test_the_compass_lock_pulls_with_0_8_of_the_error_a_second() -> None:
    loop = YawLoop(AttitudeGains.from_parameters(), LoopConfig(), 0.0)
    loop.locked_yaw, loop.heading = 0.0, math.radians(10.0)
    *_, (rate, yaw) = turning(loop, 0.0, 1.5, loop.heading)
    assert -rate / yaw == pytest.approx(0.8, rel=0.1)

"""The FlightCtrl's attitude loop: what stick counts make the aircraft do.

Per axis, with `u` the stick in radians of wanted tilt (docs/lab/simulator.md, attitude loop; FlightCtrl 2.12a)::

    us  = (3 us + u) / 4                   stick low-pass, with every receiver frame, FC >= 2.10 only
    w   -> -a1 (th - us) - a2 z            through the lag of the rate loop;   z' = th - us
    th' = q trunc(w / q) - q trunc((th - tacc) / q ta)

`th` is the FC's own idea of tilt, `tacc` what the accelerometer calls down. The last term is the leak: an accelerometer
does not see gravity while the aircraft accelerates, so a constant command keeps tilting the aircraft while the
FlightCtrl believes its angle is held. Gyro and leak are whole counts a loop (`COUNT`, q): nothing leaks below q ta,
0.35 deg without a NaviCtrl, and half a count less above than a time constant of ta would let through. Noise of the
accelerometer blurs the steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypedDict

from mksim.config import LoopConfig

LOOP_PERIOD: Final = 2.048e-3
"""Period of the FlightCtrl's control loop [s] (488 Hz)."""
STICK_LAG: Final = 0.078
"""Mean delay of the stick low-pass of FC >= 2.10, (3 old + new) / 4 with every receiver frame of 22.5 ms: three frames,
and the half frame that sticks wait for one [s]."""
COUNT: Final = math.radians(1.0 / 1220.0) / LOOP_PERIOD
"""One count of the integrated gyro a loop [rad/s]: 0.4 deg/s, the smallest rate and the smallest leak."""
LEAK_MOST: Final = 32
"""Largest leak [count a loop]; AUSGLEICH in FlightCtrl fc.c."""
ACCELEROMETER_SHARE: Final = 0.25
"""Of a new reading in the tilt of the accelerometer, (3 old + new) / 4 with every loop; FlightCtrl fc.c."""
LEAK_SLOW: Final = 7.1
"""Time constant of the leak with a newer NaviCtrl [s]."""
LEAK_FAST: Final = 0.885
"""Time constant of the leak without NaviCtrl, or with NaviCtrl 0.24 [s]."""
GYRO_COUNTS_PER_DEG: Final = 1220.0
"""Integrated gyro counts per degree."""
YAW_DEAD_BAND: Final = 4.0
"""Yaw stick counts that do nothing."""
YAW_UNLOCK: Final = 8.0
"""Yaw stick count from which the FlightCtrl gives up its compass heading."""
_ANGLE_SCALE: Final = 11000.0
YAW_GAIN: Final = 18.0
"""Yaw acceleration per rate error [1/s]."""
YAW_INTEGRAL_GAIN: Final = 56.0
"""Yaw acceleration per integrated rate error [1/s2]. Fitted to the genuine step: t63 .08 s, overshoot 40 %, settled in
.35 s (docs/lab/simulator.md, attitude loop)."""
_YAW_INTEGRAL_LIMIT: Final = math.radians(30.0)
"""Bound of the integrated rate error [rad]."""
_INTEGRAL_LIMIT: Final = math.radians(60.0)
"""Bound of the integral term [rad s]: far outside flight, it only keeps a tumbling model finite."""


@dataclass(frozen=True, slots=True)
class AttitudeGains:
    """The loop's constants in SI, from a parameter set.

    Attributes:
        rad_per_count: wanted tilt per stick count [rad].
        a1: proportional gain [1/s].
        a2: integral gain [1/s2].
        ta: time constant of the leak towards the accelerometer [s].
        ts: stick low-pass [s]; 0 without.
        stick_p: set value Stick_P: resolution of the integer stick filter.
        yaw_linear: yaw rate per count [rad/s].
        yaw_square: yaw rate per squared count [rad/s].
        compass: the set lets the compass hold the heading.
    """

    rad_per_count: float
    a1: float
    a2: float
    ta: float
    ts: float
    stick_p: float
    yaw_linear: float
    yaw_square: float
    compass: bool = True

    @classmethod
    def from_parameters(
        cls,
        *,
        stick_p: int = 6,
        gyro_p: int = 100,
        gyro_i: int = 120,
        i_factor: int = 16,
        gyro_stability: int = 6,
        stick_yaw_p: int = 4,
        stick_filter: bool = True,
        ta: float = LEAK_FAST,
        compass: bool = True,
    ) -> AttitudeGains:
        """Compute the constants from a parameter set; the defaults are the Easy set.

        Args:
            stick_p: Stick_P.
            gyro_p: Gyro_P.
            gyro_i: Gyro_I; zero (heading hold) is taken as 1, the loop has no angle feedback there.
            i_factor: I_Faktor.
            gyro_stability: Gyro_Stability, zero is taken as 1.
            stick_yaw_p: StickGier_P.
            stick_filter: the firmware filters its sticks (FC >= 2.10).
            ta: leak time constant [s], `LEAK_FAST` or `LEAK_SLOW`.
            compass: the compass bit of GlobalConfig.

        Source: docs/lab/simulator.md, attitude loop.
        """
        gyro_i = max(1, gyro_i)
        a1 = gyro_i * 64.0 / ((gyro_p + 10) * _ANGLE_SCALE * LOOP_PERIOD)
        ki = max(1, int(10300 / (i_factor + 1)))
        a2 = a1 * (1.0 / LOOP_PERIOD / ki) / (max(1, gyro_stability) / 8.0)
        return cls(
            rad_per_count=math.radians(_ANGLE_SCALE * stick_p / (gyro_i * GYRO_COUNTS_PER_DEG)),
            a1=a1,
            a2=a2,
            ta=ta,
            ts=STICK_LAG if stick_filter else 0.0,
            stick_p=float(max(1, stick_p)),
            yaw_linear=math.radians(0.1 * stick_yaw_p),
            yaw_square=math.radians(0.0047 / 6.0 * stick_yaw_p),
            compass=compass,
        )


class GainSet(TypedDict):
    """The settings that shape pitch and roll."""

    stick_p: int
    gyro_p: int
    gyro_i: int
    i_factor: int
    gyro_stability: int


EASY: Final = GainSet(stick_p=6, gyro_p=100, gyro_i=120, i_factor=16, gyro_stability=6)
"""The default parameter set: 0.451 deg per count."""
AGILE: Final = GainSet(stick_p=8, gyro_p=100, gyro_i=120, i_factor=16, gyro_stability=6)
"""0.601 deg per count."""
FAST: Final = GainSet(stick_p=10, gyro_p=90, gyro_i=120, i_factor=32, gyro_stability=6)
"""0.751 deg per count, twice the integral gain."""


class AxisLoop:
    """Pitch or roll.

    Attributes:
        stick: filtered stick [count].
        believed: the FlightCtrl's own tilt, `th` [rad].
        integral: `z` [rad s].
        acceleration: angular acceleration the loop asks for [rad/s2].
    """

    __slots__ = (
        "_a1",
        "_a2",
        "_is_filtered",
        "_lag",
        "_leak_step",
        "_leaned",
        "_rad_per_count",
        "_stick_p",
        "_truncate",
        "acceleration",
        "believed",
        "integral",
        "stick",
    )

    def __init__(self, gains: AttitudeGains, config: LoopConfig) -> None:
        self._lag = config.rate_lag
        self._truncate = config.truncate_sticks
        self._leaned = 0.0
        self.stick = self.believed = self.integral = self.acceleration = 0.0
        self.set_gains(gains)

    def set_gains(self, gains: AttitudeGains) -> None:
        """Fly on with another parameter set."""
        self._a1, self._a2 = gains.a1, gains.a2
        self._rad_per_count = gains.rad_per_count
        self._stick_p = gains.stick_p
        self._is_filtered = gains.ts > 0.0
        self._leak_step = COUNT * gains.ta

    def take_stick(self, stick: float) -> None:
        """Take the stick of a receiver frame [count], positive towards positive tilt.

        The low-pass counts in whole units of count * Stick_P: a growing stick stalls up to 3 units short.
        """
        if not self._is_filtered:
            self.stick = stick
        elif self._truncate:
            units = round(self.stick * self._stick_p)
            self.stick = int((3 * units + stick * self._stick_p) / 4.0) / self._stick_p
        else:
            self.stick = (3.0 * self.stick + stick) / 4.0

    def update(self, rate: float, leaned: float, coupling: float, *, flying: bool) -> None:
        """Advance by one loop period.

        Args:
            rate: gyro on this axis [rad/s].
            leaned: tilt the accelerometer shows, `tacc` [rad].
            coupling: rate this axis gains from yawing while tilted [rad/s].
            flying: the integral works; on the ground the FlightCtrl holds it at zero.
        """
        error = self.believed - self.stick * self._rad_per_count
        integral = self.integral
        wanted = -self._a1 * error - self._a2 * integral
        self.acceleration = (wanted - rate) / self._lag
        if flying:
            integral += error * LOOP_PERIOD
            self.integral = max(-_INTEGRAL_LIMIT, min(_INTEGRAL_LIMIT, integral))
        else:
            self.integral = 0.0
        self._leaned += (leaned - self._leaned) * ACCELEROMETER_SHARE
        counts = int((self.believed - self._leaned) / self._leak_step)
        leak = COUNT * max(-LEAK_MOST, min(LEAK_MOST, counts))
        turned = COUNT * int(rate / COUNT)
        self.believed += (turned + coupling - leak) * LOOP_PERIOD


class YawLoop:
    """Yaw: a rate stick with a dead band, and a heading lock on the compass while it rests.

    Attributes:
        acceleration: angular acceleration the loop asks for [rad/s2].
        heading: the FlightCtrl's fused heading as ENU yaw [rad].
        locked_yaw: heading the lock holds, ENU yaw [rad].
    """

    __slots__ = (
        "_gain",
        "_has_compass",
        "_integral",
        "_lag",
        "_linear",
        "_lock",
        "_square",
        "acceleration",
        "heading",
        "locked_yaw",
    )

    FUSION: Final = 2.0
    """Time in which the compass pulls the gyro heading [s]."""

    def __init__(self, gains: AttitudeGains, config: LoopConfig, heading: float) -> None:
        self._lag = config.yaw_torque_lag
        self._integral = 0.0
        self._has_compass = config.compass_lock
        self._gain = config.compass_lock_gain
        self.acceleration = 0.0
        self.heading = self.locked_yaw = heading
        self.set_gains(gains)

    def set_gains(self, gains: AttitudeGains) -> None:
        """Fly on with another parameter set."""
        self._linear, self._square = gains.yaw_linear, gains.yaw_square
        self._lock = self._has_compass and gains.compass

    def update(self, stick: float, rate: float, compass: float, *, flying: bool) -> None:
        """Advance by one loop period.

        Args:
            stick: [count], positive nose left.
            rate: yaw gyro [rad/s].
            compass: compass as ENU yaw [rad].
            flying: on the ground the lock follows the heading.
        """
        self.heading += rate * LOOP_PERIOD
        if self._lock:
            self.heading += _wrap(compass - self.heading) * (LOOP_PERIOD / self.FUSION)
        size = abs(stick)
        wanted = 0.0
        if size > YAW_DEAD_BAND:
            size -= YAW_DEAD_BAND
            wanted = math.copysign(self._linear * size + self._square * size * size, stick)
        if not self._lock or not flying or abs(stick) >= YAW_UNLOCK:
            self.locked_yaw = self.heading
        else:
            wanted += self._gain * _wrap(self.locked_yaw - self.heading)
        error = wanted - rate
        asked = YAW_GAIN * error + YAW_INTEGRAL_GAIN * self._integral
        self.acceleration += (asked - self.acceleration) * (LOOP_PERIOD / self._lag)
        integral = self._integral + error * LOOP_PERIOD if flying else 0.0
        self._integral = max(-_YAW_INTEGRAL_LIMIT, min(_YAW_INTEGRAL_LIMIT, integral))


def _wrap(angle: float) -> float:
    """Wrap to [-pi, pi]."""
    return math.remainder(angle, 2.0 * math.pi)

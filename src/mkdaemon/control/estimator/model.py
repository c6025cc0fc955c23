"""The aircraft as a plant: its response to the sticks, from the parameter set of its FlightCtrl.

One horizontal axis, with `u` the stick in radians of wanted tilt (docs/control.md, "The attitude loop")::

    p'  = v                                  position relative to the target
    v'  = g t - c v + d                      d: acceleration by wind, by the target's own motion, by model errors
    t'  = w                                  true tilt
    th' = w - (th - (c v - d) / g - b) / ta  the FlightCtrl's own estimate of the tilt; the last term is its leak
    z'  = th - us
    w'  = (-a1 (th - us) - a2 z - w) / tw    the rate loop
    us' = (u - us) / ts                      the stick filter of FC >= 2.10, small before
    b' = 0                                   tilt of the accelerometers against the airframe

and the vertical axis, with `q` the squared ratio of throttle to hover throttle, less one::

    h' = s;   s' = g f + e;   f' = (q - f) / tm;   e: acceleration by errors of the hover throttle, wind, ground effect
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final

import numpy as np

from mkdaemon.control.estimator.wholenumbers import WholeNumbers
from mkdaemon.control.linear import Array, discretise

GRAVITY: Final = 9.81
"""[m/s2]."""
FC_PERIOD: Final = 2.048e-3
"""Period of the FlightCtrl's loop [s]; docs/firmware-notes.md, "Timing"."""
STICK_FILTER: Final = 0.078
"""Stick filter of FC >= 2.10 [s]: (3 old + new) / 4 at receiver frames of 22.5 ms, and half a frame of waiting."""
NO_FILTER: Final = 0.0113
"""Without it sticks wait for half a receiver frame [s]; FlightCtrl up to 2.08."""
LEAK_FAST: Final = 0.885
"""Leak without a NaviCtrl or with 0.24 [s]; docs/lab/simulator.md."""
LEAK_SLOW: Final = 7.1
"""Leak with a newer NaviCtrl [s]."""
LEAK_COUNT: Final = math.radians(1.0 / 1220.0) / FC_PERIOD
"""The smallest leak there is, one count of the integrated gyro a loop [rad/s]: 0.4 deg/s; docs/lab/genuine.md."""
LEAK_BLUR: Final = 0.4
"""Noise of the accelerometers in what leaks, as a standard deviation [count]."""
ACCELEROMETER_SCALE: Final = 0.9
"""Tilt that the accelerometers show over that in which they are: 0.79 to 1 on boards of 170 to 216 counts a g."""
CABLE_UPLINK: Final = 0.0045
"""By cable, time from writing a stick frame until it is in the firmware's memory [s]; docs/lab/genuine.md."""
CABLE_AGE: Final = 0.030
"""By cable an attitude is so old when it arrives [s]: the boards collect it every 20 ms, for their SPI bus;
docs/lab/genuine.md."""
PACKED_AGE: Final = 0.080
"""The same behind a NaviCtrl whose FlightCtrl is older than 2.10, by packets of 61 ms; docs/lab/genuine-navictrl.md."""
UNMEASURED: Final = 0.009
"""Delay that an unmeasured line adds to each direction [s]: half of a radio's, so cable and radio are equally near."""
LEAST_LINE_SD: Final = 0.004
"""Least doubt about the delay of a line that was measured [s]; a third of what it adds is more where it is slow."""
SHORTEST: Final = 0.001
"""No delay is shorter [s]."""
YAW_DEAD_BAND: Final = 4.0
"""Yaw counts that do nothing; docs/firmware-notes.md."""
ROTOR_RADIUS: Final = 0.2
"""Of the largest rotors this flies with [m]; docs/simulator.md."""
ROTOR_HEIGHT: Final = 0.1
"""Of the rotors above the feet, at least [m]."""
LARGEST_CUSHION: Final = 1.25
"""Largest gain of thrust near the ground; docs/simulator.md."""
P, V, T, TH, Z, W, US, D, B = range(9)
LEVEL_STATES: Final = 9
"""Places in the state of a horizontal axis; how many there are."""
H, S, F, E = range(4)
"""Places in the state of the vertical axis."""


def ground_effect(height: float | Array) -> Array:
    """Return the gain of thrust with the feet at heights above the ground [m].

    `1 / (1 - (R / 4z)^2)`, with the rotors at z: I. Cheeseman and W. Bennett, ARC R&M 3021, 1955.
    """
    ratio = (ROTOR_RADIUS / (4.0 * (np.maximum(height, 0.0) + ROTOR_HEIGHT))) ** 2
    return np.minimum(1.0 / (1.0 - ratio), LARGEST_CUSHION)


class Gap(Enum):
    """Reason for which a parameter set gives no model."""

    UNREAD = auto()
    """The set could not be read, its layout is not known, or it has no such parameter."""
    ON_POTENTIOMETER = auto()
    """A gain stands for a potentiometer of the transmitter, and the pilot may turn it."""
    NO_AIRCRAFT = auto()
    """With this value the stick tilts or turns nothing, or no angle is fed back: the model does not hold."""


@dataclass(frozen=True, slots=True)
class ModelUnknown:
    """The set does not say how this aircraft answers its sticks.

    Attributes:
        gap: why.
        parameter: whose value it is, named as in docs/settings.md; empty where none is known.
        value: of that parameter.
        poti: which potentiometer it stands for, 1 to 8; None for none.
    """

    gap: Gap
    parameter: str = ""
    value: int = 0
    poti: int | None = None


@dataclass(frozen=True, slots=True)
class AircraftModel:
    """The constants of one aircraft, all of them positive.

    Attributes:
        rad_per_count: tilt that a stick count asks for [rad].
        a1: proportional gain of the attitude loop [1/s].
        a2: integral gain of the attitude loop [1/s2].
        leak: time constant `ta` with which the FlightCtrl's tilt follows its accelerometers [s].
        stick_filter: `ts` [s].
        rate_lag: `tw` of the closed rate loop [s].
        drag: `c`, of the airframe [1/s].
        thrust_lag: `tm` [s].
        yaw_linear: yaw rate per count beyond the dead band [rad/s].
        yaw_square: yaw rate per squared count beyond it [rad/s].
        uplink: from the moment a stick frame is written until it is in the boards' memory [s]; how it waits for a
            receiver frame there is a part of `stick_filter`.
        attitude_age: of a reported attitude when it arrives [s].
        line_sd: how well the sum of the last two is known before a flight, as a standard deviation [s].
        cable_age: `attitude_age` by a cable [s].

    Raises:
        ValueError: a constant is not a positive number.
    """

    rad_per_count: float = math.radians(0.451)
    a1: float = 3.10
    a2: float = 3.33
    leak: float = LEAK_FAST
    stick_filter: float = STICK_FILTER
    rate_lag: float = 0.022
    drag: float = 0.35
    thrust_lag: float = 0.060
    yaw_linear: float = math.radians(0.4)
    yaw_square: float = math.radians(0.0047 / 6 * 4)
    uplink: float = CABLE_UPLINK + UNMEASURED
    attitude_age: float = CABLE_AGE + UNMEASURED
    line_sd: float = UNMEASURED
    cable_age: float = CABLE_AGE

    def __post_init__(self) -> None:
        if not all(0.0 < getattr(self, name) < math.inf for name in self.__slots__):
            msg = f"every constant of a model is a positive number: {self}"
            raise ValueError(msg)

    @classmethod
    def from_parameters(
        cls,
        *,
        stick_p: int,
        gyro_p: int,
        gyro_i: int,
        integral_factor: int,
        gyro_stability: int,
        stick_yaw_p: int,
        has_stick_filter: bool,
        has_slow_leak: bool,
    ) -> AircraftModel | ModelUnknown:
        """Compute the constants from values of the active parameter set, named as in docs/settings.md.

        A gain of 0 makes no aircraft: the sticks tilt or turn nothing, or the set flies without angle feedback.

        Args:
            stick_p: tilt per count.
            gyro_p: rate gain.
            gyro_i: angle gain.
            integral_factor: integral gain.
            gyro_stability: scales rate and integral.
            stick_yaw_p: yaw rate per count.
            has_stick_filter: FC >= 2.10.
            has_slow_leak: a NaviCtrl newer than 0.24 is mounted.

        Source: docs/control.md, "The attitude loop".
        """
        needed = {"stick_p": stick_p, "gyro_i": gyro_i, "gyro_stability": gyro_stability, "stick_yaw_p": stick_yaw_p}
        for name, value in needed.items():
            if value <= 0:
                return ModelUnknown(Gap.NO_AIRCRAFT, name, value)
        a1 = gyro_i * 64.0 / ((gyro_p + 10) * 11000.0 * FC_PERIOD)
        integral = max(1, 10300 // (integral_factor + 1))
        return cls(
            rad_per_count=math.radians(11000.0 * stick_p / (gyro_i * 1220.0)),
            a1=a1,
            a2=a1 / (FC_PERIOD * integral) * 8.0 / gyro_stability,
            leak=LEAK_SLOW if has_slow_leak else LEAK_FAST,
            stick_filter=STICK_FILTER if has_stick_filter else NO_FILTER,
            yaw_linear=math.radians(0.1 * stick_yaw_p),
            yaw_square=math.radians(0.0047 / 6.0 * stick_yaw_p),
        )

    def with_other_filter(self) -> AircraftModel:
        """Return the same aircraft without its stick filter, or with one where it has none."""
        return replace(self, stick_filter=STICK_FILTER if self.stick_filter <= NO_FILTER else NO_FILTER)

    def by_packets(self) -> AircraftModel:
        """Return the same aircraft with attitudes that an old FlightCtrl sends by packets and a NaviCtrl hands on."""
        return replace(self, cable_age=PACKED_AGE, attitude_age=PACKED_AGE + UNMEASURED)

    def by_line(self, added: float) -> AircraftModel:
        """Return the same aircraft behind a line that adds `added` to a cable's delay, each way [s]."""
        return replace(
            self,
            uplink=CABLE_UPLINK + added,
            attitude_age=self.cable_age + added,
            line_sd=max(LEAST_LINE_SD, added / 3.0),
        )

    def later(self, lag: float) -> AircraftModel:
        """Return the same aircraft with `lag` more delay of sticks and reports together [s], divided equally."""
        uplink, age = (max(SHORTEST, delay + lag / 2.0) for delay in (self.uplink, self.attitude_age))
        return replace(self, uplink=uplink, attitude_age=age)

    def yaw_stick(self, rate: float) -> float:
        """Return the stick that turns at a rate [rad/s], the inverse of the firmware's parabola; 0 below the dead band.

        Source: docs/lab/simulator.md, "Yaw".
        """
        size = abs(rate)
        if size < self.yaw_linear:
            return 0.0
        root = math.sqrt(self.yaw_linear**2 + 4.0 * self.yaw_square * size)
        return math.copysign(YAW_DEAD_BAND + (root - self.yaw_linear) / (2.0 * self.yaw_square), rate)

    def horizontal(self, step: float) -> tuple[Array, Array]:
        """Return transition (9, 9) and input (9,) of a horizontal axis over a step [s], its leak linear."""
        a, b = self._level()
        a[TH] += self._leaked() * -LEAK_COUNT
        f, g = discretise(a, b, step)
        return f, g[:, 0]

    def counted(self, step: float) -> tuple[Array, Array, WholeNumbers]:
        """Return transition (9, 9), input (9,) and leak of a horizontal axis over a step [s]: whole counts leak."""
        a, b = self._level()
        down = np.zeros((LEVEL_STATES, 1))
        down[TH] = -LEAK_COUNT
        f, g = discretise(a, np.concatenate([b, down], axis=1), step)
        return f, g[:, 0].copy(), WholeNumbers(self._leaked(), g[:, 1].copy(), LEAK_BLUR)

    def _leaked(self) -> Array:
        """What the FlightCtrl counts of the state (9,): its tilt less that of its accelerometers [count]."""
        row = np.zeros(LEVEL_STATES)
        row[[TH, V, D, B]] = 1.0, -ACCELEROMETER_SCALE * self.drag / GRAVITY, ACCELEROMETER_SCALE / GRAVITY, -1.0
        leaked: Array = row / (LEAK_COUNT * self.leak)
        return leaked

    def _level(self) -> tuple[Array, Array]:
        """Rates (9, 9) and input (9, 1) of a horizontal axis without its leak."""
        a, b = np.zeros((LEVEL_STATES, LEVEL_STATES)), np.zeros((LEVEL_STATES, 1))
        # p' = v; v' = g t - drag v + d; t' = w, and without its leak the FlightCtrl's own tilt th' = w;
        # z' = th - us; rate_lag w' = -a1 (th - us) - a2 z - w; stick_filter us' = u - us.
        # Source: docs/control.md, "The attitude loop".
        a[P, V] = 1.0
        a[V, T], a[V, V], a[V, D] = GRAVITY, -self.drag, 1.0
        a[T, W] = 1.0
        a[TH, W] = 1.0
        a[Z, TH], a[Z, US] = 1.0, -1.0
        a[W, TH], a[W, US], a[W, Z], a[W, W] = (
            -self.a1 / self.rate_lag,
            self.a1 / self.rate_lag,
            -self.a2 / self.rate_lag,
            -1.0 / self.rate_lag,
        )
        a[US, US], b[US, 0] = -1.0 / self.stick_filter, 1.0 / self.stick_filter
        return a, b

    def vertical(self, step: float) -> tuple[Array, Array]:
        """Return transition (4, 4) and input (4,) of the vertical axis over a step [s]."""
        a, b = np.zeros((4, 4)), np.zeros((4, 1))
        # h' = s; s' = g f + e - drag s; thrust_lag f' = u - f, with u = (gas / hover gas)^2 - 1.
        a[H, S] = 1.0
        a[S, F], a[S, E], a[S, S] = GRAVITY, 1.0, -self.drag
        a[F, F], b[F, 0] = -1.0 / self.thrust_lag, 1.0 / self.thrust_lag
        f, g = discretise(a, b, step)
        return f, g[:, 0]

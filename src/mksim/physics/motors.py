"""Plus mixer, motor lag and thrust of four rotors.

Motor 1 is at the front, 2 at the rear, 3 right, 4 left; 1 and 2 turn against 3 and 4. Signs as seen on the motors
(docs/firmware-notes.md): nose down lowers 1 and raises 2, left side down raises 3 and lowers 4, nose left raises 1
and 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mksim.config import AirframeConfig
from mksim.physics.airframe import GRAVITY

MAX_COUNT: Final = 254.0
"""Largest motor set point."""
MIN_COUNT: Final = 8.0
"""Smallest set point of a turning motor: the controller never lets a motor stop in flight."""
HOVER_CELL_V: Final = 3.2
"""Cell voltage at which the hover count hovers [V]: rotor speed goes with set point times voltage."""
MIXER_LOSS: Final = 0.9
"""What the FlightCtrl's mixer loses by rounding down [count]."""
MOTORS_ON_BUS: Final = 12
"""Motor slots the FlightCtrl knows."""
DYNAMIC_STABILITY: Final = 70 / 64
"""Most pitch and roll, over throttle and half of the yaw: DynamicStability of the sets Easy and Agile. FlightCtrl fc.c
limits its regulators by it before the mixer, so that a standing aircraft with idling motors stays where it is."""
LEAST_YAW_THROTTLE: Final = 40.0
"""Most yaw is half of the throttle, or half of this where it is more [count]: MIN_GIERGAS of the same place."""


@dataclass(frozen=True, slots=True)
class GasChain:
    """How the FlightCtrl makes a motor set point of its gas, in whole numbers.

    Attributes:
        reference: battery voltage at which the two are the same [V]; above it the gas is reduced, below it fades.
        least: smallest compensated gas [count].
        most: largest compensated gas [count], with room for the mixer.
    """

    reference: float = 12.8
    least: int = 18
    most: int = 210

    def compensated(self, gas: float, voltage: float) -> int:
        """Return what is left of a gas at a voltage [V]: what the board flies with, and reports [count]."""
        measured, reference = int(10.0 * voltage), round(10.0 * self.reference)
        count = int(gas)
        if measured > reference > 0:
            count = count * reference // measured
        return max(self.least, min(self.most, count))

    def setpoint(self, gas: float, voltage: float) -> float:
        """Return the set point of a level aircraft [count]; the fraction is what the mixer's sums still see."""
        return self.compensated(gas, voltage) - MIXER_LOSS


FACTORY_CHAIN: Final = GasChain()
"""That of the factory's sets on a 4-cell pack."""


class Motors:
    """Turns a collective count and three angular accelerations into thrust and torque.

    Only the collective passes through the motor lag: the 40 ms of the closed rate loop already holds the motors' share
    of the delay, and counting it twice would make the loop slower than the aircraft's.

    Attributes:
        thrust: sum over the rotors [N].
        torque_x: about body forward [N m].
        torque_y: about body left [N m].
        torque_z: about body up [N m].
        load: electrical power over that of hover.
        setpoints: what the FlightCtrl sends each motor [count], `MOTORS_ON_BUS` entries.
        health: share of its thrust each rotor still gives.
    """

    __slots__ = (
        "_arm",
        "_collective",
        "_hover_v",
        "_lag",
        "_load_scale",
        "_pitch_count",
        "_roll_count",
        "_thrust_per_count2",
        "_torque_per_thrust",
        "_yaw_count",
        "health",
        "load",
        "setpoints",
        "thrust",
        "torque_x",
        "torque_y",
        "torque_z",
    )

    def __init__(self, config: AirframeConfig, cells: int) -> None:
        """Start with the rotors standing; `cells` of the pack say at which voltage the hover count hovers."""
        hover = config.hover_count
        # A rotor's thrust is k n^2 at a count n; four of them carry the weight at the hover count.
        self._thrust_per_count2 = config.mass * GRAVITY / (4.0 * hover * hover)
        self._load_scale = 1.0 / (4.0 * self._thrust_per_count2 * hover**3)
        self._arm = config.arm
        self._torque_per_thrust = config.torque_per_thrust
        self._lag = config.motor_lag
        slope = 2.0 * self._thrust_per_count2 * hover  # thrust per count at hover [N/count]
        # Counts for an angular acceleration a: J a = 2 arm slope dn for two rotors about pitch and roll, and
        # J a = 4 (torque per thrust) slope dn for all four about yaw.
        self._pitch_count = config.inertia_pitch / (2.0 * config.arm * slope)
        self._roll_count = config.inertia_roll / (2.0 * config.arm * slope)
        self._yaw_count = config.inertia_yaw / (4.0 * config.torque_per_thrust * slope)
        self._hover_v = cells * HOVER_CELL_V
        self._collective = 0.0
        self.health = [1.0, 1.0, 1.0, 1.0]
        self.setpoints = [0] * MOTORS_ON_BUS
        self.thrust = self.torque_x = self.torque_y = self.torque_z = self.load = 0.0

    def spin_up(self, count: float) -> None:
        """Start with the rotors already turning at `count`."""
        self._collective = count

    def update(
        self,
        gas: float,
        alpha_x: float,
        alpha_y: float,
        alpha_z: float,
        voltage: float,
        chain: GasChain,
        dt: float,
    ) -> None:
        """Advance the rotors while the motors run.

        Args:
            gas: before voltage compensation [count].
            alpha_x: angular acceleration wanted about body forward [rad/s2].
            alpha_y: about body left [rad/s2].
            alpha_z: about body up [rad/s2].
            voltage: of the battery [V].
            chain: how gas becomes a set point.
            dt: [s].
        """
        # counts are those that give the same thrust at the hover voltage; a set point is one of them over `speed`
        speed = voltage / self._hover_v
        level = chain.setpoint(gas, voltage) * speed
        # The motor's lag: dn/dt = (level - n) / lag.
        self._collective += (level - self._collective) * min(1.0, dt / self._lag)
        base = self._collective
        # The FlightCtrl's own limits, see `DYNAMIC_STABILITY` and `LEAST_YAW_THROTTLE`.
        most = max(level, LEAST_YAW_THROTTLE) / 2.0
        yaw = max(-most, min(most, alpha_z * self._yaw_count))
        most = DYNAMIC_STABILITY * (max(level, 0.0) + abs(yaw) / 2.0)
        pitch = max(-most, min(most, alpha_y * self._pitch_count))
        roll = max(-most, min(most, alpha_x * self._roll_count))
        bottom, top = MIN_COUNT * speed, MAX_COUNT * speed
        # Mixer of the plus frame: front, rear, right, left; front and rear turn against right and left.
        counts = (base + yaw - pitch, base + yaw + pitch, base - yaw - roll, base - yaw + roll)
        health, setpoints = self.health, self.setpoints
        # Thrust T = k n^2 of each rotor; torque about forward a (T_left - T_right), left a (T_rear - T_front), and up
        # c (T_front + T_rear - T_right - T_left).
        factor = self._thrust_per_count2
        thrusts = []
        load = 0.0
        for i in range(4):
            count = counts[i]
            count = bottom if count < bottom else top if count > top else count
            # the set point follows the stick at once; the lagged collective is the rotor's own inertia
            setpoints[i] = int(min(MAX_COUNT, max(MIN_COUNT, (count + level - base) / speed)))
            push = factor * count * count
            load += push * count  # the power of a rotor goes with the cube of its speed
            thrusts.append(push * health[i])
        self.load = load * self._load_scale
        front, rear, right, left = thrusts
        self.thrust = front + rear + right + left
        self.torque_x = self._arm * (left - right)
        self.torque_y = self._arm * (rear - front)
        self.torque_z = self._torque_per_thrust * (front + rear - right - left)

    def coast(self, dt: float) -> None:
        """Advance the rotors with the motors off."""
        self._collective -= self._collective * min(1.0, dt / self._lag)
        self.setpoints[0] = self.setpoints[1] = self.setpoints[2] = self.setpoints[3] = 0
        self.thrust = 4.0 * self._thrust_per_count2 * self._collective * self._collective
        self.torque_x = self.torque_y = self.torque_z = self.load = 0.0

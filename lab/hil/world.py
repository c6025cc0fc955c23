"""The simulator's world, flown by genuine firmware in place of the simulated FlightCtrl.

Air, airframe, battery, pilot and faults are the simulator's own. What the simulator knows only as a law, the regulator
and its motors, is here the firmware, four motor controllers and four rotors with their own lag.
"""

from __future__ import annotations

import math
from typing import Final

from lab.hil.chip import Chip, Held, control_of
from mksim.config import FlightConfig
from mksim.physics.airframe import GRAVITY, GroundContact
from mksim.physics.motors import HOVER_CELL_V, MAX_COUNT
from mksim.physics.pilot import STICK_LIMIT
from mksim.physics.world import DT, SLOW_STEPS, StartState, StickInput, World

SUBSTEPS: Final = 4
"""Physics runs four times as often as the simulator's law: the firmware converts 2000 times a second."""
GYRO_LSB: Final = 1.2577 * 180.0 / math.pi
"""Steps of the converter a rad/s: 1220 counts of the integral are one degree at the firmware's loop of 485 Hz."""
GYRO_RANGE: Final = math.radians(400.0)
"""Of the sensors [rad/s]."""
ACC_LSB: Final = 170.0 / GRAVITY
"""Steps a m/s2: the board's own check expects 170 for one g."""
CENTRE: Final = 512.0
BAROMETER: Final = 800.0 + 190 * 52.0
"""Level on the ground with the firmware's analog output at zero [LSB]."""
BAROMETER_LSB: Final = -100.0 / 15.0
"""Steps a metre: one step is 15 cm."""
VOLTAGE_LSB: Final = 31.0
"""Steps a volt."""
NOISE: Final = (0.8, 0.8, 0.8, 0.7, 0.0, 1.5, 1.5, 1.5)
"""Standard deviation of one conversion of each channel [LSB]: gyros, barometer, battery, accelerometer."""
COUNTS_PER_RAD: Final = 1220.0 * 180.0 / math.pi
"""Of the firmware's angle integrals."""
GATE_OPEN: Final = 128
"""External control acts where its parameter evaluates to more."""
CHANNELS, STICKS = 9, 4
"""Of the transmitter: throttle, roll, pitch, yaw, and switches, of which the first is potentiometer 1."""
FULL: Final = 125
"""Largest channel that the firmware's receiver takes for a stick [count]."""


class GenuineWorld(World):
    """Aircraft, air, pilot and faults around a board with genuine firmware.

    Attributes:
        chip: the board.
        has_compass: a NaviCtrl or MK3Mag hands it the heading.
    """

    def __init__(
        self,
        cfg: FlightConfig,
        chip: Chip,
        *,
        seed: int,
        start: StartState | None = None,
        ground: GroundContact | None = None,
        voltage: float | None = None,
        has_compass: bool = True,
    ) -> None:
        """Set the aircraft up; see `GenuineAircraft`."""
        super().__init__(cfg, seed=seed, start=start, ground=ground)
        airframe = cfg.airframe
        self.chip = chip
        self.has_compass = has_compass
        self._voltage = voltage
        self._layout = control_of(chip.firmware)
        self._rotors = [0.0, 0.0, 0.0, 0.0]
        self._lag = airframe.motor_lag
        self._thrust_per_count2 = airframe.mass * GRAVITY / (4.0 * airframe.hover_count**2)
        self._hover_v = cfg.battery.cells * HOVER_CELL_V
        self._load_scale = 1.0 / (4.0 * self._thrust_per_count2 * airframe.hover_count**3)
        self._arm, self._twist = airframe.arm, airframe.torque_per_thrust
        chip.lines.noise[:] = NOISE
        chip.lines.channels = CHANNELS
        self._measure()
        self._transmit()

    @property
    def voltage(self) -> float:
        """Of the battery [V]."""
        return self._battery.voltage if self._voltage is None else self._voltage - self._battery.drop

    @property
    def is_armed(self) -> bool:
        """Whether the firmware turns the motors."""
        return self.chip.peek("MotorenEin", "<B") != 0

    @property
    def is_controlled(self) -> bool:
        """Whether the firmware follows external control: it is valid, and the gate is open."""
        return self.held[-1] and self.chip.peek("Parameter_ExternalControl", "<B") > GATE_OPEN

    @property
    def held(self) -> Held:
        """External control as the firmware holds it."""
        return self.chip.held(self._layout)

    def _fly(self, sticks: StickInput) -> None:
        """Let the firmware fly one step; the sticks it flies by are in its own memory."""
        self._transmit()
        self._update_beliefs()
        if self._step % SLOW_STEPS == 0 and self.has_compass:
            self.chip.poke("KompassValue", (round(self.sensors.compass_deg) % 360).to_bytes(2, "little"))
        dt, wind = DT / SUBSTEPS, self._wind
        for part in range(SUBSTEPS):
            at = self.now + part * dt
            self._run_chip(at + dt)
            thrust, torque = self._turn_rotors(dt)
            self._airframe.step(thrust, torque, (wind.east, wind.north, wind.up), at, dt)
            self._measure()

    def _run_chip(self, until: float) -> None:
        """Run the processor on."""
        self.chip.run_to(until, max(self.now, until - DT / SUBSTEPS))

    def _turn_rotors(self, dt: float) -> tuple[float, tuple[float, float, float]]:
        """Thrust [N] and torque [N m; FLU] of four rotors whose speed follows set point times voltage with a lag."""
        speed = self.voltage / self._hover_v
        share = 1.0 - math.exp(-dt / self._lag)
        rotors, motor = self._rotors, self.chip.lines.motor
        pushes, load = [], 0.0
        for i in range(4):
            wanted = 0.0 if self._airframe.crashed else min(MAX_COUNT, motor[i]) * speed
            rotors[i] += (wanted - rotors[i]) * share
            push = self._thrust_per_count2 * rotors[i] * rotors[i]
            load += push * rotors[i]
            pushes.append(push * self._motors.health[i])
        self._motors.load = load * self._load_scale
        front, rear, right, left = pushes
        torque = self._arm * (left - right), self._arm * (rear - front), self._twist * (front + rear - right - left)
        return front + rear + right + left, torque

    def _measure(self) -> None:
        """Put what the sensors measure on the converter's channels."""
        airframe, analog = self._airframe, self.chip.lines.analog
        limit = GYRO_RANGE

        def rate(value: float) -> float:
            return GYRO_LSB * max(-limit, min(limit, value))

        analog[0] = CENTRE + 0.3 - rate(airframe.rate_z)
        analog[1] = CENTRE + 0.3 - rate(airframe.rate_x)
        analog[2] = CENTRE + 0.3 + rate(airframe.rate_y)
        analog[3] = BAROMETER + BAROMETER_LSB * (airframe.up - self._config.airframe.leg_height)
        analog[4] = VOLTAGE_LSB * self.voltage
        analog[5] = CENTRE + ACC_LSB * airframe.force_z
        analog[6] = CENTRE + ACC_LSB * airframe.force_y
        analog[7] = CENTRE - ACC_LSB * airframe.force_x

    def _transmit(self) -> None:
        """Put the pilot's sticks and switches on the receiver."""
        pilot, lines = self.pilot, self.chip.lines
        lines.is_receiving = int(pilot.rc_quality > 0)
        switches = [pilot.gate, *(pilot.switches.get(number, 0) for number in range(2, CHANNELS - STICKS + 1))]
        values = (pilot.gas, pilot.roll, pilot.pitch, pilot.yaw, *(switch - STICK_LIMIT for switch in switches))
        lines.channel[:CHANNELS] = [max(-FULL, min(FULL, value)) for value in values]

    def _update_beliefs(self) -> None:
        """What the firmware believes of its angles, for the hand of the pilot."""
        self._pitch.believed = self.chip.peek("IntegralNick", "<i") / COUNTS_PER_RAD
        self._roll.believed = -self.chip.peek("IntegralRoll", "<i") / COUNTS_PER_RAD

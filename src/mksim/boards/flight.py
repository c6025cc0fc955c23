"""What a FlightCtrl does with its sticks: mixing, gestures, reception, emergency throttle, motors on and off.

Everything here happens when a receiver frame arrives (22.5 ms), or every 0.53 s without one, as on the board.
Source: docs/firmware-notes, "External control"; docs/protocol.md, "When it acts".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.flags import FlightStatus, FlightStatus2
from mksim.boards.aircraft import SimulatedAircraft, Transmitter
from mksim.boards.external import FULL, RC_LOST, ExternalControl, ExternalSticks
from mksim.boards.generations import SLOW_TICK, FcFirmware
from mksim.boards.gestures import Gesture, GestureReader, chosen_set
from mksim.boards.parameters import Parameters
from mksim.physics.motors import GasChain
from mksim.physics.world import MOTORS_OFF, StickInput

RECEIVER_FRAME: Final = 0.0225
"""Period of the receiver's pulse train."""
BLIND_PERIOD: Final = 0.53
"""How often sticks are evaluated when no pulse train comes."""
POTIS: Final = 8
_CHANNELS: Final = 16
_HEIGHT_CONTROL: Final = 0x01
"""Bit of GlobalConfig."""
GATE_OPEN: Final = 128
"""The parameter must evaluate to more than this."""
_QUALITY_STEP: Final = 10
_QUALITY_TO_START: Final = 140
_FLYING_GAS: Final = 40.0
_FLYING_TIME: Final = 256 * 2.048e-3
"""Time with throttle after which the FlightCtrl counts itself flying."""
_EMERGENCY_FLIGHT: Final = 2.06
"""Time with throttle after which a lost receiver starts the emergency throttle; before, the motors stop."""
_ALTITUDE_ON: Final = 70.0
_ALTITUDE_OFF: Final = 50.0
"""Values of the altitude channel [count] above and below which height control goes on and off."""
_IDLE_MARGIN: Final = 10
"""Idle over the set's minimum, after voltage compensation: a set point of 17, as measured."""
_MIXER_MARGIN: Final = 20
"""Room under the set's maximum for the mixer."""
_EMERGENCY_UNIT: Final = 0.1024
"""Unit of the emergency time: nine seconds in the set are 9.2 on the clock."""
_CELL_FULL: Final = 4.3
_VOLTS_OF_PACK: Final = 50
"""A low-voltage warning below this counts per cell [0.1 V]."""


def read_potis(pilot: Transmitter) -> tuple[int, ...]:
    """Values of potis 1..8, 0..255; poti 1 is the external-control switch."""
    return (pilot.gate, *(pilot.switches.get(number, 0) for number in range(2, POTIS + 1)))


class SimulatedFlight:
    """The flying part of the board.

    Attributes:
        mixed: sticks after external control was added, as last sampled.
        receiver: the pilot's sticks alone.
        quality: reception, 0..200.
        running: motors on.
        flying: throttle has been up for half a second.
        calibrated: gyros and accelerometers have been zeroed since power-on.
        emergency: flying on emergency throttle.
        gate_open: the external-control parameter evaluates to more than 128.
        controlled: external control acted on the last sample.
        pulses: flags that last until they have been handed to the NaviCtrl once.
    """

    def __init__(
        self, generation: FcFirmware, external: ExternalControl, aircraft: SimulatedAircraft, *, calibrated: bool
    ) -> None:
        self._generation = generation
        self._external = external
        self._aircraft = aircraft
        self._gestures = GestureReader()
        self._emergency_until = 0.0
        self._flown = 0.0
        self._next_at = 0.0
        self._frames = 0
        self.cells = 1 + int(aircraft.sensors.battery_voltage / _CELL_FULL)
        self.mixed = self.receiver = ExternalSticks(0.0, 0.0, 0.0, -FULL)
        self.quality = 0
        self.potis: tuple[int, ...] = (0,) * POTIS
        self.running = self.flying = self.emergency = False
        self.calibrated = calibrated
        self.gate_open = self.controlled = False
        self.height_control = False
        self.pulses = FlightStatus(0)
        self.chosen: int | None = None

    def is_due(self, now: float) -> bool:
        """Whether a receiver frame waits to be evaluated."""
        return now >= self._next_at

    def evaluate(self, now: float, parameters: Parameters, *, may_start: bool) -> Gesture | None:
        """Sample the receiver and external control; return a gesture that was completed."""
        pilot = self._aircraft.pilot
        quality = pilot.rc_quality
        period = RECEIVER_FRAME if quality > 0 else BLIND_PERIOD
        while self._next_at <= now:
            self._next_at += period
        if quality > 0:
            self.quality = min(quality, self.quality + 2 * _QUALITY_STEP)
            self.receiver = ExternalSticks.from_receiver(pilot)
            self.potis = read_potis(pilot)
        self._frames += 1
        self._mix(parameters)
        return self._act_on_gesture(now, parameters, may_start=may_start)

    def tick(self, now: float, parameters: Parameters) -> None:
        """Every 20 ms: reception decays without pulses, emergency flight begins and ends."""
        if self._aircraft.pilot.rc_quality <= 0:
            self.quality = max(0, self.quality - _QUALITY_STEP)
        lost = self.quality < RC_LOST and not self._external.tolerates_rc_loss
        if not lost:
            self.emergency = False
        elif self.running and not self.emergency:
            self._lose_receiver(now, parameters)
        elif self.emergency and now >= self._emergency_until:
            self.stop()
        self._count_flight(parameters)

    def _lose_receiver(self, now: float, parameters: Parameters) -> None:
        """In flight the emergency throttle takes over for a while; on the ground the motors stop."""
        if self._flown < _EMERGENCY_FLIGHT or not parameters["emergency_throttle_time"]:
            self.stop()
            return
        self.emergency = True
        self._emergency_until = now + _EMERGENCY_UNIT * parameters["emergency_throttle_time"]

    def _count_flight(self, parameters: Parameters) -> None:
        """Count the time with throttle since the motors were started."""
        if not self.running:
            self._flown = 0.0
        elif self.gas(parameters) > _FLYING_GAS:
            self._flown += SLOW_TICK
        self.flying = self._flown >= _FLYING_TIME

    def _mix(self, parameters: Parameters) -> None:
        external = self._external
        self.gate_open = parameters.evaluate("external_control", self.potis) > GATE_OPEN
        hears = self.quality >= RC_LOST or external.tolerates_rc_loss
        self.controlled = external.is_valid and self.gate_open and hears
        self.mixed = external.mix(self.receiver) if self.controlled else self.receiver
        self._switch_height_control(parameters)

    def channels(self, parameters: Parameters) -> dict[int, float]:
        """Receiver channels 1..16 that the set maps, as far as the simulated transmitter has them [count]."""
        receiver = self.receiver
        functions = (receiver.pitch, receiver.roll, receiver.throttle, receiver.yaw)
        values = [*functions, *(poti - FULL for poti in self.potis[: parameters.potis])]
        numbered = {parameters.channel(number): value for number, value in enumerate(values)}
        return {channel: value for channel, value in numbered.items() if 1 <= channel <= _CHANNELS}

    def _switch_height_control(self, parameters: Parameters) -> None:
        if not parameters["global_config"] & _HEIGHT_CONTROL:
            self.height_control = False
            return
        value = self.channels(parameters).get(parameters["altitude_channel"], 0.0)
        if value > _ALTITUDE_ON:
            self.height_control = True
        elif value < _ALTITUDE_OFF:
            self.height_control = False

    def _act_on_gesture(self, now: float, parameters: Parameters, *, may_start: bool) -> Gesture | None:
        if self.quality <= _QUALITY_TO_START:
            return None
        mixed = self._generation.gestures_mixed
        plain = not mixed or parameters["motor_safety_switch"] != 0
        sticks = self.mixed if mixed else self.receiver
        gesture = self._gestures.read(sticks, now, plain=plain)
        if gesture is Gesture.START and not self.running and self.calibrated and may_start:
            self.start()
        elif gesture is Gesture.STOP and self.running:
            self.stop()
        elif gesture is Gesture.CALIBRATE and not self.running:
            self.chosen = chosen_set(sticks)
            self.calibrate()
        else:
            return None
        return gesture

    def start(self) -> None:
        """Motors on."""
        self.running = True
        self.pulses |= FlightStatus.STARTING

    def stop(self) -> None:
        """Motors off, in flight too."""
        self.running = self.flying = self.emergency = False
        self._flown = 0.0

    def calibrate(self) -> None:
        """Zero the sensors."""
        self.calibrated = True
        self.pulses |= FlightStatus.CALIBRATING
        self._aircraft.calibrate()

    def gas(self, parameters: Parameters) -> float:
        """Collective count of running motors before voltage compensation, 0..254."""
        if self.emergency:
            return float(parameters["emergency_throttle"])
        chain = self._chain(parameters)
        return max(chain.least, min(chain.most, self.mixed.throttle + FULL))

    def reported_gas(self, parameters: Parameters) -> int:
        """Collective count as the board reports it, after voltage compensation; 0 while the motors stand."""
        if not self.running:
            return 0
        return self._chain(parameters).compensated(self.gas(parameters), self._aircraft.sensors.battery_voltage)

    def _chain(self, parameters: Parameters) -> GasChain:
        return GasChain(
            reference=self.low_voltage(parameters),
            least=parameters["throttle_min"] + _IDLE_MARGIN,
            most=parameters["throttle_max"] - _MIXER_MARGIN,
        )

    def low_voltage(self, parameters: Parameters) -> float:
        """Voltage of the low-battery warning, the reference of the compensation too [V]."""
        level = parameters["low_voltage_warning"]
        return 0.1 * (level * self.cells if level < _VOLTS_OF_PACK else level)

    def stick_input(self, parameters: Parameters) -> StickInput:
        """What the attitude loop gets."""
        if not self.running:
            return MOTORS_OFF
        gas = self.gas(parameters)
        if self.emergency:
            return StickInput(
                0.0, 0.0, 0.0, gas, motors_running=True, chain=self._chain(parameters), frame=self._frames
            )
        mixed = self.mixed
        return StickInput(
            mixed.pitch,
            mixed.roll,
            mixed.yaw,
            gas,
            motors_running=True,
            height_control=self.height_control,
            chain=self._chain(parameters),
            frame=self._frames,
        )

    def battery_is_low(self, parameters: Parameters) -> bool:
        """Whether the voltage is under the warning level."""
        return self._aircraft.sensors.battery_voltage < self.low_voltage(parameters)

    def status(self, parameters: Parameters) -> FlightStatus:
        """FCStatusFlags; the pulses stay until `take_pulses`."""
        flags = self.pulses
        if self.running:
            flags |= FlightStatus.MOTORS_RUNNING
        if self.flying:
            flags |= FlightStatus.FLYING
        if self.emergency:
            flags |= FlightStatus.EMERGENCY_LANDING
        if self.battery_is_low(parameters):
            flags |= FlightStatus.LOW_BATTERY
        return flags

    def status_2(self) -> FlightStatus2:
        """FCStatusFlags2."""
        flags = FlightStatus2(0)
        if self.height_control and self.running:
            flags |= FlightStatus2.ALTITUDE_CONTROL
        if self.emergency:
            flags |= FlightStatus2.RC_FAILSAFE
        return flags

    def take_pulses(self) -> None:
        """The NaviCtrl has seen the pulses."""
        self.pulses = FlightStatus(0)

"""The simulated safety pilot: a transmitter with sticks, switches and a gate, and a person who may act.

Sticks are RC channels as the receiver hands them to the FlightCtrl: -127..127, firmware signs (pitch positive nose
down, roll positive left side down, yaw positive nose left, gas positive up), the signs of the `b` frame that is added
to them.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from mksim.config import PilotConfig
from mksim.physics.airframe import Airframe
from mksim.physics.attitude_loop import AttitudeGains, AxisLoop
from mksim.physics.battery import SimulatedBattery

RC_PERIOD: Final = 0.0225
"""A receiver frame [s]."""
STICK_LIMIT: Final = 127
"""Largest channel value."""
GPS_SWITCH: Final = 2
"""Poti of the GPS mode in the factory's sets."""
GPS_SWITCH_FREE: Final = 50
"""Values above this hold the position."""
GPS_SWITCH_VALUES: Final = {"free": 0, "hold": 127, "home": 255}
GOOD_RC: Final = 200
"""Receiver level of a healthy link."""


@dataclass(slots=True)
class FlightView:
    """What the pilot sees and feels: he stands beside the aircraft and knows how it flies."""

    airframe: Airframe
    pitch: AxisLoop
    roll: AxisLoop
    gains: AttitudeGains
    battery: SimulatedBattery
    motors_running: bool = False


class PilotProgram(Protocol):
    """Something the pilot does for a while."""

    def fly(self, pilot: SimulatedPilot, view: FlightView, now: float) -> None:
        """Move the sticks; called at every receiver frame."""

    @property
    def doing(self) -> str:
        """What the pilot does, or waits for, after "the pilot"."""

    @property
    def is_over(self) -> bool:
        """The aircraft stands, its motors stopped, and nothing more will happen."""


class DelayedProgram:
    """A program that begins after a while, or when asked: a ground station looks at the boards first.

    Attributes:
        program: what begins then.
    """

    def __init__(self, program: PilotProgram, wait_time: float) -> None:
        """Wait `wait_time` [s] from the first receiver frame on."""
        self.program = program
        self._wait_time = wait_time
        self._starts_at: float | None = None
        self._is_waiting = wait_time > 0.0

    def start(self) -> None:
        """Begin with the next receiver frame."""
        self._wait_time = 0.0
        self._starts_at = None
        self._is_waiting = False

    def fly(self, pilot: SimulatedPilot, view: FlightView, now: float) -> None:
        """Leave the sticks alone until it is time."""
        if self._starts_at is None:
            self._starts_at = now + self._wait_time
        self._is_waiting = now < self._starts_at
        if not self._is_waiting:
            self.program.fly(pilot, view, now)

    @property
    def doing(self) -> str:
        """What the pilot does; see `PilotProgram`."""
        if self._is_waiting:
            return f"waits {self._wait_time:g} s before he touches the sticks; `mkctl sim start` asks him earlier"
        return self.program.doing

    @property
    def is_over(self) -> bool:
        """It was flown to its end; see `PilotProgram`."""
        return not self._is_waiting and self.program.is_over


class SimulatedPilot:
    """The transmitter in the hands of a person.

    Attributes:
        pitch: stick, nose down positive.
        roll: stick, LEFT side down positive.
        yaw: stick, nose left positive.
        gas: stick.
        switches: values of the further channels, 0..255, by number from 1.
        program: what the pilot is doing; None leaves the sticks where they are.
        took_over_at: when he took over from external control [s], None if he did not.
        gate_fault: the gate is held shut by a fault.
        rc_lost: the receiver hears nothing.
    """

    def __init__(self, config: PilotConfig, *, rescue: Callable[[], PilotProgram]) -> None:
        """Start with neutral sticks, gas down.

        Args:
            config: reaction and limits.
            rescue: makes the program he flies after taking over.
        """
        self._config = config
        self._rescue = rescue
        self._script: list[tuple[float, int, Callable[[SimulatedPilot], None]]] = []
        self._order = itertools.count()
        self._home: tuple[float, float] | None = None
        self._hand_on_at: float | None = None
        self._gate = config.gate
        self.pitch = self.roll = self.yaw = 0
        self.gas = -STICK_LIMIT
        self.switches: dict[int, int] = {}
        self.program: PilotProgram | None = None
        self.took_over_at: float | None = None
        self.gate_fault = False
        self.rc_lost = False
        self._has_turned_gps = False

    @property
    def gate(self) -> int:
        """Value of the external-control switch, 0..255; above 128 it is open."""
        return 0 if self.gate_fault else self._gate

    @gate.setter
    def gate(self, value: int) -> None:
        self._gate = max(0, min(255, value))

    @property
    def rc_quality(self) -> int:
        """Receiver level, 0 when lost."""
        return 0 if self.rc_lost else GOOD_RC

    def set_sticks(self, *, pitch: float = 0.0, roll: float = 0.0, yaw: float = 0.0, gas: float | None = None) -> None:
        """Move the sticks, clipped to the transmitter's range; gas stays where it is unless given."""
        self.pitch, self.roll, self.yaw = _channel(pitch), _channel(roll), _channel(yaw)
        if gas is not None:
            self.gas = _channel(gas)

    def at(self, when: float, action: Callable[[SimulatedPilot], None]) -> None:
        """Do something at a simulated time [s], between two receiver frames at the latest."""
        heapq.heappush(self._script, (when, next(self._order), action))

    @property
    def leaves_place_to_board(self) -> bool:
        """Whether his GPS switch asks the NaviCtrl to hold or fly: then he leaves pitch and roll alone."""
        return self.switches.get(GPS_SWITCH, 0) > GPS_SWITCH_FREE

    def turn_gps_switch(self, to: str | None) -> None:
        """Turn the GPS switch to free, hold or home; None leaves it, or turns it back once it was turned."""
        if to is not None or self._has_turned_gps:
            self.switches[GPS_SWITCH] = GPS_SWITCH_VALUES[to or "free"]
        self._has_turned_gps = to is not None

    def take_over(self, now: float) -> None:
        """Decide at `now` [s] to take over: after the reaction time the gate closes and the pilot flies."""
        if self._hand_on_at is None and self.took_over_at is None:
            self._hand_on_at = now + self._config.reaction

    def release_control(self) -> None:
        """Stop flying, open the gate and watch again."""
        self.took_over_at = None
        self.program = None
        self.gate = self._config.gate

    def update(self, view: FlightView, now: float) -> None:
        """Run the script, watch the aircraft, move the sticks; called at every receiver frame."""
        while self._script and self._script[0][0] <= now:
            heapq.heappop(self._script)[2](self)
        if self._config.watches and self._must_take_over(view):
            self.take_over(now)
        if self._hand_on_at is not None and now >= self._hand_on_at:
            self._hand_on_at = None
            self.took_over_at = now
            self.gate = 0
            self.program = self._rescue()
        if self.program is not None:
            self.program.fly(self, view, now)

    def _must_take_over(self, view: FlightView) -> bool:
        airframe, config = view.airframe, self._config
        if self._home is None:
            self._home = (airframe.east, airframe.north)
        if airframe.on_ground or self.took_over_at is not None:
            return False
        away = math.hypot(airframe.east - self._home[0], airframe.north - self._home[1])
        speed = math.sqrt(airframe.v_east**2 + airframe.v_north**2 + airframe.v_up**2)
        tilt_deg = math.degrees(airframe.tilt)
        return away > config.watch_distance or speed > config.watch_speed or tilt_deg > config.watch_tilt_deg


def _channel(value: float) -> int:
    return max(-STICK_LIMIT, min(STICK_LIMIT, round(value)))

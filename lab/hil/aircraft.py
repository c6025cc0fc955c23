"""The aircraft with genuine firmware at the end of a line, as the daemon's cable meets it; see `mksim.simulation`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

from lab.hil.build import Firmware
from lab.hil.chip import Chip, eeprom_of
from lab.hil.world import GenuineWorld
from mksim.boards.line import HOST_CHAR
from mksim.config import PilotPlan, SimConfig
from mksim.physics.airframe import GroundContact
from mksim.physics.pilot import DelayedProgram
from mksim.physics.world import DT, MOTORS_OFF, StartState, StickInput
from mksim.radio import RadioChannel
from mksim.supervision import Supervision

ARMED = StickInput(0.0, 0.0, 0.0, 0.0, motors_running=True)
"""Tells the world only that the motors turn: the firmware has the sticks."""


class GenuineAircraft:
    """One aircraft, and the far end of its serial line.

    Attributes:
        now: simulated time [s].
        world: what flies.
    """

    _world_class: ClassVar[type[GenuineWorld]] = GenuineWorld

    def __init__(
        self,
        firmware: Firmware,
        config: SimConfig,
        *,
        start: StartState | None = None,
        ground: GroundContact | None = None,
        voltage: float | None = None,
        has_compass: bool = True,
    ) -> None:
        """Set everything up; the board is switched on at time zero.

        Args:
            firmware: that flies.
            config: world, line and pilot; what it says of boards does not count.
            start: where it stands; default the origin, nose north.
            ground: what is below; default flat.
            voltage: of the battery, held [V]; by default the battery of the configuration.
            has_compass: whether the board hears of the heading.
        """
        self.now = 0.0
        self._to_board = RadioChannel(config.radio.to_board, f"{config.seed} to board")
        self._to_host = RadioChannel(config.radio.to_host, f"{config.seed} to host")
        chip = Chip(firmware, eeprom_of(firmware), seed=config.seed)
        self.world = self._world_class(
            config.flight, chip, seed=config.seed, start=start, ground=ground, voltage=voltage, has_compass=has_compass
        )
        plan = Supervision(
            lambda: self.world.is_controlled,
            take_off=config.pilot_plan is PilotPlan.SUPERVISE,
            start_motors=config.pilot_plan is PilotPlan.START,
        )
        self.world.pilot.program = DelayedProgram(plan, config.pilot_wait)

    def write(self, data: bytes, at: float) -> None:
        """Send bytes to the board at `at` [s]."""
        self._to_board.push(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run to `to` [s] and return what reached the host: bytes with the time they arrived [s]."""
        world, faults = self.world, self.world.faults
        self._to_board.is_cut = faults.is_link_cut("to_board")
        self._to_host.is_cut = faults.is_link_cut("to_host")
        self._receive((at, byte) for at, data in self._to_board.poll(to) for byte in data)
        while world.now + DT <= to:
            world.step(ARMED if world.is_armed else MOTORS_OFF)
        for at, byte in self._read():
            # the channel counts the character's own time, which the board has counted already
            self._to_host.push(bytes((byte,)), at - HOST_CHAR)
        self.now = to
        return self._to_host.poll(to)

    def _receive(self, arrivals: Iterable[tuple[float, int]]) -> None:
        """Let characters of the host arrive, each with its time [s]."""
        self.world.chip.inbox.extend(arrivals)

    def _read(self) -> list[tuple[float, int]]:
        """Characters for the host that left the board, each with its time [s]."""
        return self.world.chip.read()

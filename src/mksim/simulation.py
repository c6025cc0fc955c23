"""The whole simulated aircraft in virtual time: world, boards, and the line to the host in both directions.

Pure: no clock, no files but the EEPROM, no network. `runtime` gives it real time and a port.
"""

from __future__ import annotations

from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.boards.line import HOST_CHAR
from mksim.boards.navictrl import NaviCtrl
from mksim.config import PilotPlan, SimConfig
from mksim.physics.hand_flight import CircleFlight, HandFlight
from mksim.physics.pilot import DelayedProgram, PilotProgram
from mksim.physics.world import World
from mksim.radio import RadioChannel
from mksim.supervision import Supervision


class Simulation:
    """One aircraft, and the far end of its serial line.

    Attributes:
        now: simulated time [s].
        world: what flies.
        flight: the FlightCtrl.
        navigation: the NaviCtrl; None where the FlightCtrl's own port is offered.
        port: the board whose port is offered.
    """

    def __init__(self, config: SimConfig, world: World | None = None) -> None:
        """Set everything up at time zero.

        Args:
            config: what to simulate.
            world: an own world, for example with a moving platform; unset makes the configured one.

        Raises:
            ConfigError: the EEPROM file cannot be used.
        """
        self.now = 0.0
        self.world = World(config.flight, seed=config.seed) if world is None else world
        self.flight = FlightCtrl(
            FC_GENERATIONS[config.fc],
            self.world,
            seed=config.seed,
            gas_law=config.gas_law,
            eeprom=config.eeprom,
            gate_parameter=config.gate_parameter,
            calibrated=config.calibrated,
        )
        self.navigation: NaviCtrl | None = None
        if config.board == "nc":
            generation = NC_GENERATIONS[config.nc]
            self.navigation = NaviCtrl(generation, self.flight, seed=config.seed, loop_time=config.nc_loop)
        self.port: NaviCtrl | FlightCtrl = self.navigation or self.flight
        self._to_board = RadioChannel(config.radio.to_board, f"{config.seed} to board")
        self._to_host = RadioChannel(config.radio.to_host, f"{config.seed} to host")
        self._config = config
        self._delayed: DelayedProgram | None
        self._give_plan(config.pilot_wait)

    def start_pilot(self) -> None:
        """Let the pilot begin now, or once more after a flight; without effect while he flies, or has no plan."""
        program = self.world.pilot.program
        if program is not None and program.is_over:
            self._give_plan(0.0)
        elif self._delayed is not None:
            self._delayed.start()

    @property
    def pilot_doing(self) -> str:
        """What the pilot does, or waits for, after "the pilot"."""
        if self.world.truth.crashed:
            return "stands beside a broken aircraft: start the simulator again"
        program = self.world.pilot.program
        return f"leaves his sticks alone ({self._config.pilot_plan})" if program is None else program.doing

    def _give_plan(self, wait_time: float) -> None:
        """Let the pilot begin with his plan after a while [s]."""
        program = self._plan(self._config.pilot_plan)
        self._delayed = None if program is None else DelayedProgram(program, wait_time)
        self.world.pilot.program = self._delayed

    def _plan(self, plan: PilotPlan) -> PilotProgram | None:
        if plan is PilotPlan.CIRCLE:
            return CircleFlight()
        if plan is PilotPlan.HOVER:
            return HandFlight()
        if plan is PilotPlan.NOTHING:
            return None
        flight = self.flight  # not its core: a reboot makes a new one
        return Supervision(
            lambda: flight.core.controlled,
            take_off=plan is PilotPlan.SUPERVISE,
            start_motors=plan is PilotPlan.START,
        )

    def write(self, data: bytes, at: float) -> None:
        """Send bytes to the board at `at` [s]; they take their time on the line."""
        self._to_board.push(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run to `to` [s] and return what reached the host: bytes with the time they arrived [s]."""
        faults = self.world.faults
        self._to_board.is_cut = faults.is_link_cut("to_board")
        self._to_host.is_cut = faults.is_link_cut("to_host")
        for at, data in self._to_board.poll(to):
            for byte in data:
                self.port.receive_byte(byte, at)
        self.port.advance(to)
        for at, data in self.port.poll():
            # the channel counts the character's own time, which the board has counted already
            self._to_host.push(data, at - HOST_CHAR)
        self.now = to
        return self._to_host.poll(to)

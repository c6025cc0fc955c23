"""An aircraft with a genuine NaviCtrl at the end of a line, as the daemon's cable meets it; see `mksim.simulation`.

The FlightCtrl behind it is the simulator's here: what the NaviCtrl does by itself is seen alone.
"""

from __future__ import annotations

from typing import Final

from lab.hil.aircraft import Line
from lab.hil.navibuild import NaviFirmware
from lab.hil.navigation import NaviBoard, Socket
from lab.hil.navipeer import SimulatedMaster, Surroundings
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.config import SimConfig
from mksim.physics.world import World

SLICE: Final = 1e-3
"""The two boards run in turn, so long each [s]."""


class NaviAircraft(Line):
    """One aircraft, and the far end of its serial line.

    Attributes:
        world: what flies.
        flight: the simulated FlightCtrl.
        board: the genuine NaviCtrl.
        master: the FlightCtrl's end of their bus.
    """

    def __init__(self, firmware: NaviFirmware, config: SimConfig) -> None:
        """Set everything up; both boards are switched on at time zero.

        Args:
            firmware: of the NaviCtrl.
            config: world, line and FlightCtrl; what it says of the NaviCtrl does not count.

        Raises:
            ConfigError: this process has run a NaviCtrl already.
        """
        super().__init__(config)
        self.world = World(config.flight, seed=config.seed)
        self.flight = FlightCtrl(
            FC_GENERATIONS[config.fc],
            self.world,
            seed=config.seed,
            gas_law=config.gas_law,
            gate_parameter=config.gate_parameter,
            calibrated=config.calibrated,
        )
        self.flight.adopt_companion(NC_GENERATIONS["0.24"].release)
        self.board = NaviBoard(firmware)
        self.master = SimulatedMaster(self.flight)
        self._surroundings = Surroundings(self.world)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run to `to` [s] and return what reached the host: bytes with the time they arrived [s]."""
        while self.now < to:
            self._run(min(to, self.now + SLICE))
        return self._answer(self.board.read(Socket.HOST), self.now)

    def _run(self, until: float) -> None:
        board, flight = self.board, self.flight
        for at, data in self._to_board.poll(until):
            board.receive(Socket.HOST, ((max(at, self.now), byte) for byte in data))
        flight.advance(until)
        for at, data in flight.poll():
            board.receive(Socket.FLIGHTCTRL, ((max(at, self.now), byte) for byte in data))
        self._surroundings.tend(board, self.now)
        self.master.exchange(board, until)
        board.run(until)
        for at, byte in board.read(Socket.FLIGHTCTRL):
            flight.receive_byte(byte, at)
        board.read(Socket.COMPASS)
        self.now = until

"""Aircraft with a genuine NaviCtrl at the end of a line, as the daemon's cable meets them; see `mksim.simulation`.

Behind it is the simulator's FlightCtrl, so that what the NaviCtrl does by itself is seen alone, or a genuine one,
joined as on an aircraft by their bus and the UART between them; that one's heading comes from the NaviCtrl's compass.
"""

from __future__ import annotations

from typing import Any, Final

from lab.hil.aircraft import GenuineAircraft, Line
from lab.hil.build import Firmware, NaviFirmware
from lab.hil.naviboard import NaviBoard, SimulatedMaster, Socket, Surroundings
from lab.hil.world import GenuineWorld
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
        """Switch both boards on; what the configuration says of the NaviCtrl does not count.

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


class PairWorld(GenuineWorld):
    """The world around both boards.

    Attributes:
        navi: the NaviCtrl.
    """

    def join(self, navi: NaviBoard) -> None:
        """Put the NaviCtrl on the FlightCtrl's bus and UART."""
        self.navi = navi
        self._surroundings = Surroundings(self)
        self.chip.connect(navi.exchange_address)

    def _run_chip(self, until: float) -> None:
        """Run the FlightCtrl, which takes the NaviCtrl along with every byte on their bus; then that one, too."""
        super()._run_chip(until)
        navi = self.navi
        begun = navi.now
        navi.receive(Socket.FLIGHTCTRL, ((max(at, begun), byte) for at, byte in self.chip.read()))
        self._surroundings.tend(navi, begun)
        navi.run(until)
        self.inbox.extend(navi.read(Socket.FLIGHTCTRL))


class NaviPair(GenuineAircraft):
    """One aircraft, and the far end of the NaviCtrl's serial line.

    Attributes:
        board: the NaviCtrl.
    """

    world: PairWorld
    _world_class = PairWorld

    def __init__(self, flight: Firmware, navi: NaviFirmware, config: SimConfig, **more: Any) -> None:
        """Switch both boards on; `more` is start, ground and voltage, see `GenuineAircraft`.

        Raises:
            ConfigError: this process has run a NaviCtrl already.
        """
        self.board = NaviBoard(navi)
        super().__init__(flight, config, has_compass=False, **more)
        self.world.join(self.board)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run to `to` [s] and return what reached the host: bytes with the time they arrived [s]."""
        board = self.board
        for at, data in self._to_board.poll(to):
            board.receive(Socket.HOST, ((max(at, board.now), byte) for byte in data))
        self._fly(to)
        board.read(Socket.COMPASS)
        return self._answer(board.read(Socket.HOST), to)

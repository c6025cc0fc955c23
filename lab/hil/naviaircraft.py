"""Aircraft with a genuine NaviCtrl at the end of a line, as the daemon's cable meets them; see `mksim.simulation`.

Behind it is the simulator's FlightCtrl, so that what the NaviCtrl does by itself is seen alone, or a genuine one,
joined as on an aircraft by their bus and the UART between them; that one's heading comes from the NaviCtrl's compass.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import Firmware, NaviFirmware
from lab.hil.naviboard import NaviBoard, SimulatedMaster, Socket, Surroundings
from lab.hil.world import GenuineWorld
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import NC_GENERATIONS
from mksim.config import SimConfig
from mksim.physics.world import World
from mksim.simulation import Simulation

SLICE: Final = 1e-3
"""The two boards run in turn, so long each [s]."""


class NaviAircraft(Simulation):
    """The simulator's aircraft with a genuine NaviCtrl in front of its FlightCtrl."""

    def __init__(self, firmware: NaviFirmware, config: SimConfig) -> None:
        """Switch both boards on; what the configuration says of the NaviCtrl does not count.

        Raises:
            ConfigError: this process has run a NaviCtrl already.
        """
        super().__init__(config.model_copy(update={"board": "fc"}))
        self.flight.adopt_companion(NC_GENERATIONS["0.24"].release)
        self.port = _NaviPort(firmware, self.flight, self.world)  # type: ignore[assignment]


class _NaviPort:
    """A genuine NaviCtrl, and the simulator's FlightCtrl behind it, as `Simulation` meets a board."""

    def __init__(self, firmware: NaviFirmware, flight: FlightCtrl, world: World) -> None:
        self._board, self._flight = NaviBoard(firmware), flight
        self._master, self._surroundings = SimulatedMaster(flight), Surroundings(world)

    def receive_byte(self, byte: int, at: float) -> None:
        self._board.receive(Socket.HOST, [(max(at, self._board.now), byte)])

    def poll(self) -> list[tuple[float, bytes]]:
        return [(at, bytes((byte,))) for at, byte in self._board.read(Socket.HOST)]

    def advance(self, to: float) -> None:
        board, flight, now = self._board, self._flight, self._flight.now
        while now < to:
            until = min(to, now + SLICE)
            flight.advance(until)
            for at, data in flight.poll():
                board.receive(Socket.FLIGHTCTRL, ((max(at, now), byte) for byte in data))
            self._surroundings.tend(board, now)
            self._master.exchange(board, until)
            board.run(until)
            for at, byte in board.read(Socket.FLIGHTCTRL):
                flight.receive_byte(byte, at)
            board.read(Socket.COMPASS)
            now = until


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
        self.chip.inbox.extend(navi.read(Socket.FLIGHTCTRL))


class NaviPair(GenuineAircraft):
    """One aircraft, and the far end of the NaviCtrl's serial line."""

    world: PairWorld
    _world_class = PairWorld

    def __init__(self, flight: Firmware, navi: NaviFirmware, config: SimConfig, **more: Any) -> None:
        """Switch both boards on; `more` is start, ground and voltage, see `GenuineAircraft`.

        Raises:
            ConfigError: this process has run a NaviCtrl already.
        """
        super().__init__(flight, config, has_compass=False, **more)
        self.world.join(NaviBoard(navi))

    def _receive(self, arrivals: Iterable[tuple[float, int]]) -> None:
        navi = self.world.navi
        navi.receive(Socket.HOST, ((max(at, navi.now), byte) for at, byte in arrivals))

    def _read(self) -> list[tuple[float, int]]:
        self.world.navi.read(Socket.COMPASS)
        return self.world.navi.read(Socket.HOST)

"""A genuine FlightCtrl and a genuine NaviCtrl, joined as on an aircraft: their bus, the UART between them.

The daemon's cable is plugged into the NaviCtrl; the FlightCtrl flies the simulator's airframe (`lab.hil.world`). Its
heading comes from the NaviCtrl's compass, by the bus.
"""

from __future__ import annotations

from typing import Any

from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import Firmware
from lab.hil.navibuild import NaviFirmware
from lab.hil.navigation import NaviBoard, Socket
from lab.hil.navipeer import Surroundings
from lab.hil.world import GenuineWorld
from mksim.config import SimConfig


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
        """Set everything up; both boards are switched on at time zero.

        Args:
            flight: firmware of the FlightCtrl.
            navi: firmware of the NaviCtrl.
            config: world, line and pilot; what it says of boards does not count.
            more: start, ground and voltage, see `GenuineAircraft`.

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

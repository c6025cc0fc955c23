"""A genuine FlightCtrl and a genuine NaviCtrl, joined as on an aircraft: their bus, the UART between them.

The daemon's cable is plugged into the NaviCtrl; the FlightCtrl flies the simulator's airframe (`lab.hil.world`). Its
heading comes from the NaviCtrl's compass, by the bus.
"""

from __future__ import annotations

from lab.hil import eeprom
from lab.hil.build import Firmware
from lab.hil.chip import Chip
from lab.hil.navibuild import NaviFirmware
from lab.hil.navigation import NaviBoard, Socket
from lab.hil.navipeer import Surroundings
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


class NaviPair:
    """One aircraft, and the far end of the NaviCtrl's serial line.

    Attributes:
        now: simulated time [s].
        world: what flies.
        board: the NaviCtrl.
    """

    def __init__(
        self,
        flight: Firmware,
        navi: NaviFirmware,
        config: SimConfig,
        *,
        voltage: float,
        start: StartState | None = None,
        ground: GroundContact | None = None,
    ) -> None:
        """Set everything up; both boards are switched on at time zero.

        Args:
            flight: firmware of the FlightCtrl.
            navi: firmware of the NaviCtrl.
            config: world, line and pilot; what it says of boards does not count.
            voltage: of the battery, held [V].
            start: where it stands; default the origin, nose north.
            ground: what is below; default flat.

        Raises:
            ConfigError: this process has run a NaviCtrl already.
        """
        self.now = 0.0
        self.board = NaviBoard(navi)
        chip = Chip(flight, eeprom.content(flight), seed=config.seed)
        self.world = PairWorld(
            config.flight, chip, seed=config.seed, start=start, ground=ground, voltage=voltage, has_compass=False
        )
        plan = Supervision(
            lambda: self.world.is_controlled,
            take_off=config.pilot_plan is PilotPlan.SUPERVISE,
            start_motors=config.pilot_plan is PilotPlan.START,
        )
        self.world.pilot.program = DelayedProgram(plan, config.pilot_wait)
        self.world.join(self.board)
        self._to_board = RadioChannel(config.radio.to_board, f"{config.seed} to board")
        self._to_host = RadioChannel(config.radio.to_host, f"{config.seed} to host")

    def write(self, data: bytes, at: float) -> None:
        """Send bytes to the board at `at` [s]; they take their time on the line."""
        self._to_board.push(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run to `to` [s] and return what reached the host: bytes with the time they arrived [s]."""
        world, board = self.world, self.board
        for at, data in self._to_board.poll(to):
            board.receive(Socket.HOST, ((max(at, board.now), byte) for byte in data))
        while world.now + DT <= to:
            world.step(ARMED if world.is_armed else MOTORS_OFF)
        board.read(Socket.COMPASS)
        for at, byte in board.read(Socket.HOST):
            # the channel counts the character's own time, which the board has counted already
            self._to_host.push(bytes((byte,)), at - HOST_CHAR)
        self.now = to
        return self._to_host.poll(to)

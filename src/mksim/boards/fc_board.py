"""The state of a FlightCtrl: what its commands change and its replies read. `fc` runs its main loop over it."""

from __future__ import annotations

from pathlib import Path

from mkdaemon.protocol.wire import Board, WireMessage
from mksim.boards.aircraft import Aircraft
from mksim.boards.display import MenuPages
from mksim.boards.eeprom import Eeprom
from mksim.boards.external import ExternalControl
from mksim.boards.fc_requests import FcRequests
from mksim.boards.flight import FlightCore
from mksim.boards.generations import FcGeneration
from mksim.boards.line import FC_CHAR, BoardPort
from mksim.boards.motors import MotorBench
from mksim.boards.parameters import Parameters
from mksim.boards.reception import FcReceiver
from mksim.config import GasLaw


class FcBoard(BoardPort):
    """One FlightCtrl without its main loop.

    Attributes:
        generation: its release.
        aircraft: what it flies.
        is_fork: the public fork: its gas law, its commands x e r o, its endless debug stream.
        eeprom: what it keeps without power.
        external: the external control it holds.
        motors: motor test and motor controller settings.
        menu: the display page shown.
        trim: steps by which the keys of the accelerometer page have moved its offset.
        live: the parameter set in RAM.
        core: what flies.
        rx: the receive interrupt.
        requests: replies asked for, and streams.
        serial_channels: what `y` brought.
        has_companion: a NaviCtrl is on its SPI bus.
        companion_release: the NaviCtrl's release.
        companion_error: error code the NaviCtrl reports; motors do not start while it is not 0.
        forced_heading: compass value a `K` frame brought [deg]; the NaviCtrl's next one replaces it.
        bridged: the line is connected to another board until power-off.
        blocked_until: the main loop is busy until then [s].
        keeps_buffer: the command at work still holds the receive buffer: what comes meanwhile is lost.
        booted_at: when the last boot is over [s]; before that it is silent on every bus.
    """

    def __init__(
        self,
        generation: FcGeneration,
        aircraft: Aircraft,
        *,
        gas_law: GasLaw = GasLaw.STOCK,
        eeprom: Path | None = None,
        gate_parameter: int = 0,
        calibrated: bool = False,
    ) -> None:
        """Power the board up; it is ready at once, as after a long time on the bench.

        Args:
            generation: which release it is.
            aircraft: what it flies.
            gas_law: stock or fork.
            eeprom: file that keeps its settings.
            gate_parameter: ExternalControl in a new EEPROM's parameter sets.
            calibrated: no calibration is needed before the motors start.

        Raises:
            ConfigError: the EEPROM file cannot be used.
        """
        super().__init__(FC_CHAR)
        self.generation = generation
        self.aircraft = aircraft
        self.is_fork = gas_law is GasLaw.FORK
        self.eeprom = Eeprom(generation.revision, eeprom, gate_parameter=gate_parameter)
        self.external = ExternalControl(generation, gas_law)
        self.motors = MotorBench(self.eeprom)
        self.menu = MenuPages(generation.menu_pages)
        self.trim = 0
        self.live = Parameters(self.eeprom.sets[self.eeprom.active])
        self.has_companion = False
        self.companion_release = (0, 0, 0)
        self.companion_error = 0
        self.booted_at = 0.0
        self.reset_state(calibrated=calibrated)
        self._apply_gains()

    def reset_state(self, *, calibrated: bool) -> None:
        """Set what a reset loses to its first value."""
        self.core = FlightCore(self.generation, self.external, self.aircraft, calibrated=calibrated)
        self.rx = FcReceiver(self.generation.buffer)
        self.requests = FcRequests(compass_at=self.now)
        self.serial_channels = [-127] * 12
        self.forced_heading: int | None = None
        self.bridged = False
        self.blocked_until = 0.0
        self.keeps_buffer = False

    def cut(self, at: float) -> None:
        """Give up the frame being sent, but for the character on the line."""
        self._out.cut(at)

    def send(self, message: WireMessage, at: float, address: Board = Board.FC) -> float:
        """Put a message on the line at `at` [s] or behind the frame leaving; return when it is out [s]."""
        return self._out.send(message.to_frame(address), at)

    def send_when_free(self, message: WireMessage, at: float) -> None:
        """As replies that wait for the transmitter inside their command: the loop stands still meanwhile."""
        busy = self._out.busy_until
        self.send(message, max(at, busy))
        self.block(max(at, busy))

    def block(self, until: float) -> None:
        """The main loop is busy until then [s]: frames are not handled, one is kept."""
        self.blocked_until = max(self.blocked_until, until)

    def load(self, number: int) -> None:
        """Copy a stored set into RAM; it is flown from now on."""
        self.live = Parameters(self.eeprom.sets[number])
        self._apply_gains()

    def adopt_companion(self, release: tuple[int, int, int]) -> None:
        """A NaviCtrl is on the SPI bus."""
        self.has_companion = True
        self.companion_release = release
        self._apply_gains()

    def _apply_gains(self) -> None:
        # NaviCtrl 0.24 sends no attitude correction, so the accelerometer pulls as fast as without any
        leak_is_slow = self.has_companion and self.companion_release >= (2, 0, 0)
        gains = self.live.gains(stick_filter=self.generation.stick_filter, leak_is_slow=leak_is_slow)
        self.aircraft.set_attitude_gains(gains)

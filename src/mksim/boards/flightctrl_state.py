"""The state of a FlightCtrl: what its commands change and its replies read. `flightctrl` runs its main loop over it.

Part of it are the replies asked for, one slot a kind, its subscriptions, and the bench of the motors: motor test and
the settings of the motor controllers.

Source: docs/firmware-notes, "Subscriptions" and "Commands with side effects"; docs/protocol.md, section 7.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from mkdaemon.protocol.flags import MotorControllerStatus
from mkdaemon.protocol.messages import MotorController, MotorControllerWritten, MotorTestDone
from mkdaemon.protocol.wire import Board, WireMessage
from mksim.boards.aircraft import SimulatedAircraft
from mksim.boards.display import MenuPages
from mksim.boards.eeprom import BL_SIZE, MOTORS, Eeprom, bl_checksum
from mksim.boards.external import ExternalControl
from mksim.boards.flight import SimulatedFlight
from mksim.boards.generations import FC_MS, SHORT_PASS, FcFirmware
from mksim.boards.line import FC_CHAR, BoardPort
from mksim.boards.parameters import Parameters
from mksim.boards.reception import FcReceiver
from mksim.config import GasLaw

SUBSCRIPTION_TIME: Final = 4000 * 1.025e-3
"""Time from the last renewal until a stream stops [s]: 4.1 s as measured."""


@dataclass(slots=True)
class StartedStream:
    """A subscription."""

    interval: int = 0
    due: float = 0.0

    def restart(self, now: float) -> None:
        """Begin a period at `now`."""
        self.due = now + (10 * self.interval + 1) * FC_MS + SHORT_PASS

    def is_due(self, now: float) -> bool:
        """Whether a frame must go out."""
        return self.interval > 0 and now >= self.due


@dataclass(slots=True)
class FcRequests:
    """Replies asked for and not yet sent, one slot each (None and False mean nothing is wanted), and the streams.

    Attributes:
        compass_at: when the next unasked compass feed is due [s].
        expire_at: when the streams end unless they are renewed [s].
    """

    compass_at: float
    version: int | None = None
    control: bool = False
    debug: bool = False
    label: int | None = None
    display: bool = False
    menu: int | None = None
    receiver: bool = False
    debug_stream: StartedStream = field(default_factory=StartedStream)
    attitude_stream: StartedStream = field(default_factory=StartedStream)
    display_stream: StartedStream = field(default_factory=StartedStream)
    expire_at: float = 0.0

    def renew(self, now: float) -> None:
        """Keep the streams alive."""
        self.expire_at = now + SUBSCRIPTION_TIME

    def end_expired(self, now: float, *, debug_is_endless: bool) -> None:
        """Stop the streams that were not renewed."""
        if now < self.expire_at:
            return
        self.attitude_stream.interval = self.display_stream.interval = 0
        if not debug_is_endless:
            self.debug_stream.interval = 0


MOTOR_TEST: Final = 0.52
"""How long one `t` turns the motors."""
BL_READ: Final = 59e-3
"""Bus time to read a motor controller's settings: the whole reply is there 61 to 67 ms after the request."""
BL_WRITE: Final = 0.25
_MOTOR_SLOTS: Final = 16
_LONG_FRAME: Final = 21
"""Characters from which `t` copies sixteen values; shorter frames copy four."""
_COMPATIBLE: Final = 0x02
_COMPATIBLE_MASK: Final = 0x0B


class MotorBench:
    """The motor test and the BL settings.

    Attributes:
        values: set points of the last `t`; kept, with their time frozen, while motors run.
    """

    def __init__(self, eeprom: Eeprom) -> None:
        self._eeprom = eeprom
        self.values = bytes(_MOTOR_SLOTS)
        self._left = 0.0
        self._last = 0.0

    def test(self, payload: bytes, frame_chars: int, now: float) -> WireMessage:
        """Take a `t`; the motors turn for half a second once nothing else drives them."""
        count = _MOTOR_SLOTS if frame_chars >= _LONG_FRAME else 4
        self.values = payload[:count] + self.values[count:]
        self._left = MOTOR_TEST
        self._last = now
        return MotorTestDone()

    def pass_time(self, now: float, *, running: bool) -> None:
        """Let the test's time run; it stands still while motors run."""
        if not running:
            self._left = max(0.0, self._left - (now - self._last))
        self._last = now

    @property
    def is_testing(self) -> bool:
        """Whether a motor test drives the motors."""
        return self._left > 0.0 and any(self.values)

    def setpoints(self, now: float) -> list[int] | None:
        """Set points of a running test, one a motor."""
        return list(self.values) if self.is_testing else None

    def _refusal(self, motor: int, *, running: bool) -> MotorControllerStatus | None:
        if running or self._left > 0.0:
            return MotorControllerStatus.MOTORS_RUNNING
        if motor > MOTORS:
            return MotorControllerStatus.NO_SUCH_MOTOR
        return None

    def read(self, motor: int, *, running: bool) -> MotorController:
        """Build U."""
        status = self._refusal(motor, running=running)
        if status is None and motor == 0:
            status = MotorControllerStatus.CANNOT_READ
        raw = self._eeprom.motor_configs[min(max(motor, 1), MOTORS) - 1]
        done = status is None
        head = bytes((int(done), 0 if status is None else int(status), motor))
        return MotorController.decode(head + raw)

    def write(self, motor: int, raw: bytes, *, running: bool) -> MotorControllerWritten:
        """Take a BL configuration and build W; motor 0 means all."""
        status = self._refusal(motor, running=running)
        if status is None and raw[0] & _COMPATIBLE_MASK != _COMPATIBLE:
            status = MotorControllerStatus.FIRMWARE_INCOMPATIBLE
        if status is None and bl_checksum(raw) != raw[BL_SIZE - 1]:
            status = MotorControllerStatus.CHECKSUM
        if status is not None:
            return MotorControllerWritten(done=0, status=status)
        for index in range(MOTORS) if motor == 0 else (motor - 1,):
            self._eeprom.motor_configs[index] = raw
        self._eeprom.save()
        return MotorControllerWritten(done=1, status=MotorControllerStatus.SUCCESS)


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
        collected: pitch and roll as `C` tells them [rad]; it tells those of the cycle before.
        packed: pitch and roll of its packets to a NaviCtrl [rad]: one under way, and before it the newest that arrived.
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
        generation: FcFirmware,
        aircraft: SimulatedAircraft,
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
        self.core = SimulatedFlight(self.generation, self.external, self.aircraft, calibrated=calibrated)
        self.rx = FcReceiver(self.generation.buffer)
        self.requests = FcRequests(compass_at=self.now)
        self.collected = self._collecting = (0.0, 0.0)
        self.packed = [(0.0, 0.0)] * 2
        self._packet_tick = 0
        self.serial_channels = [-127] * 12
        self.forced_heading: int | None = None
        self.bridged = False
        self.blocked_until = 0.0
        self.keeps_buffer = False

    def collect(self) -> None:
        """Every 20 ms the angles for the SPI bus are collected; `C` tells them a cycle later: 30 ms old by cable.

        Source: docs/lab/genuine.md.
        """
        sensors = self.aircraft.sensors
        self.collected, self._collecting = self._collecting, (sensors.fc_angle_pitch, sensors.fc_angle_roll)
        self._pack()

    def _pack(self) -> None:
        """A packet starts every `packet_ticks` ticks; the NaviCtrl has it one tick before the next one starts.

        Source: docs/lab/genuine-navictrl.md.
        """
        ticks = self.generation.packet_ticks
        if self._packet_tick == ticks - 1:
            self.packed[0] = self.packed[1]
        elif self._packet_tick == 0:
            self.packed[1] = self._collecting
        self._packet_tick = (self._packet_tick + 1) % max(1, ticks)

    @property
    def reported_angles(self) -> tuple[float, float]:
        """Pitch and roll as a NaviCtrl knows them now [rad]: what was collected for its bus, or came in a packet."""
        return self.packed[0] if self.generation.packet_ticks else self.collected

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

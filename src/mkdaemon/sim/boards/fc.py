"""The FlightCtrl: one loop pass every 2 ms, one receive buffer, one frame leaving at a time.

`receive` takes characters with the time they were put on the line, `advance` runs the board to a time, `poll` returns
characters with the time their stop bit was out. Nothing here knows real time. Behaviour and figures:
docs/firmware-notes; what each command does is in `fc_commands`, what is said in `fc_replies`.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Final

from mkdaemon.config.sim import GasLaw
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.sim.boards.aircraft import Aircraft
from mkdaemon.sim.boards.display import FcMenu
from mkdaemon.sim.boards.eeprom import Eeprom
from mkdaemon.sim.boards.external import ExternalControl
from mkdaemon.sim.boards.fc_commands import handle
from mkdaemon.sim.boards.fc_speech import Speech
from mkdaemon.sim.boards.flight import FlightCore
from mkdaemon.sim.boards.generations import LONG_PASS, LONG_SHARE, SHORT_PASS, SLOW_TICK, FcGeneration
from mkdaemon.sim.boards.gestures import Gesture
from mkdaemon.sim.boards.line import FC_CHAR, BoardPort
from mkdaemon.sim.boards.motors import MotorBench
from mkdaemon.sim.boards.parameters import Parameters
from mkdaemon.sim.boards.reception import FcReceiver
from mkdaemon.sim.physics.world import DT, MOTORS_OFF

BOOT: Final = 5.0
"""From reset to the first handled frame."""
RESET: Final = 0.25
"""From `R` to the watchdog's reset."""
CALIBRATE_BUSY: Final = 1.5
_ACTUATION: Final = 0.5e-3
"""From the pass after sticks were evaluated to the set points on the motor bus."""
_BANNER: Final = "\r\n\r\nFlight-Ctrl HW:{hardware} SW:{release}\r\nreceiver: PPM\r\nACC neutral: {neutral}\r\n"


class FlightCtrl(BoardPort):
    """One FlightCtrl.

    Attributes:
        generation: its release.
        is_fork: the public fork: its gas law, its commands x e r o, its endless debug stream.
        live: the parameter set in RAM.
        has_companion: a NaviCtrl is on its SPI bus.
        booted_at: when the last boot is over [s]; before that it is silent on every bus.
        companion_error: error code the NaviCtrl reports; motors do not start while it is not 0.
        forced_heading: compass value a `K` frame brought [deg]; the NaviCtrl's next one replaces it.
    """

    def __init__(
        self,
        generation: FcGeneration,
        aircraft: Aircraft,
        *,
        seed: int,
        gas_law: GasLaw = GasLaw.STOCK,
        eeprom: Path | None = None,
        gate_parameter: int = 0,
        calibrated: bool = False,
    ) -> None:
        """Power the board up; it is ready at once, as after a long time on the bench.

        Args:
            generation: which release it is.
            aircraft: what it flies.
            seed: of its loop's jitter.
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
        self.menu = FcMenu(generation)
        self.live = Parameters(self.eeprom.sets[self.eeprom.active])
        self.has_companion = False
        self.companion_release = (0, 0, 0)
        self.companion_error = 0
        self.booted_at = 0.0
        self._gas_law = gas_law
        self._rng = random.Random(f"{seed} fc")
        self._next_pass = self._rng.uniform(0.0, SHORT_PASS)
        self._begin(calibrated=calibrated)
        self._apply_gains()

    def _begin(self, *, calibrated: bool) -> None:
        """State that a reset loses."""
        self.core = FlightCore(self.generation, self.external, self.aircraft, calibrated=calibrated)
        self.rx = FcReceiver(self.generation.buffer)
        self.speech = Speech(self)
        self.serial_channels = [-127] * 12
        self.forced_heading: int | None = None
        self.bridged = False
        self._blocked_until = 0.0
        self._next_tick = self.now
        self._reset_at: float | None = None
        self._sticks = self._next_sticks = MOTORS_OFF
        self._sticks_at = 0.0

    # --- time ---

    def advance(self, to: float) -> None:
        """Run to `to` [s]."""
        while self._next_pass <= to:
            now = self._next_pass
            is_long = self._rng.random() < LONG_SHARE
            self._next_pass = now + (LONG_PASS if is_long else SHORT_PASS)
            self.now = now
            self._pass(now)
        self._fly_to(to)
        self.now = to

    def _pass(self, now: float) -> None:
        """One turn of the main loop."""
        self._fly_to(now)
        for at, byte in self._line.take(now):
            if not self.bridged and self.rx.take(byte) and self.rx.buffer.command == "R":
                self._ask_reset(at)
        if self._reset_at is not None and now >= self._reset_at:
            self.reboot(now)
        if self.aircraft.faults.take("fc_reboot"):
            self.reboot(now)
        if now < self._blocked_until or self.bridged:
            return
        self._keep_time(now)
        if self.core.is_due(now):
            self._evaluate(now)
        if self._out.busy_until <= now:
            self.speech.talk(now)
        if self.rx.has_frame:
            handle(self, now)
            self.rx.release()

    def _fly_to(self, to: float) -> None:
        """Let the aircraft fly under the sticks in force."""
        aircraft = self.aircraft
        while aircraft.now + DT <= to:
            if self._next_sticks is not self._sticks and aircraft.now + DT > self._sticks_at:
                self._sticks = self._next_sticks
            aircraft.step(self._sticks)

    def _keep_time(self, now: float) -> None:
        while self._next_tick <= now:
            self._next_tick += SLOW_TICK
            self.core.tick(now, self.live)
            self.external.tick_until(now)
            self.motors.pass_time(now, running=self.core.running)
            self._command()

    def _evaluate(self, now: float) -> None:
        """A receiver frame: sample sticks, obey gestures, move the motors one pass later."""
        gesture = self.core.evaluate(now, self.live, may_start=self.companion_error == 0)
        if gesture is Gesture.CALIBRATE:
            if self.core.chosen is not None:
                self.eeprom.active = self.core.chosen
                self.load(self.core.chosen)
                self.eeprom.save()
            self.block(now + CALIBRATE_BUSY)
        self._command()

    def _command(self) -> None:
        sticks = self.core.stick_input(self.live)
        if sticks != self._next_sticks:
            self._next_sticks = sticks
            self._sticks_at = self._next_pass + _ACTUATION

    # --- what commands do ---

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
        self._blocked_until = max(self._blocked_until, until)

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
        generation = self.generation
        gains = self.live.gains(stick_filter=generation.stick_filter, leak_is_slow=leak_is_slow)
        self.aircraft.set_attitude_gains(gains)

    def _ask_reset(self, at: float) -> None:
        """`R` acts in the receive interrupt."""
        self.rx.release()
        if not (self.generation.reset_gated and self.core.running):
            self._reset_at = at + RESET

    def reboot(self, now: float) -> None:
        """Reset: motors off, everything volatile lost, five seconds until the next frame is handled."""
        self.external.clear()
        self.now = now
        self._out.cut(now)
        self.load(self.eeprom.active)
        self._begin(calibrated=False)
        self.booted_at = now + BOOT
        self.block(self.booted_at)
        banner = _BANNER.format(hardware="2.2", release=self.generation.label, neutral="ok")
        self._out.send(banner.encode("ascii"), now + 0.1)

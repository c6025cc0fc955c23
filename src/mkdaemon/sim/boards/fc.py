"""The FlightCtrl: one loop pass every 2 ms, one receive buffer, one frame leaving at a time.

`receive` takes characters with the time they were put on the line, `advance` runs the board to a time, `poll` returns
characters with the time their stop bit was out. Nothing here knows real time. Behaviour and figures:
docs/firmware-notes; what each command does is in `fc_commands`, what is said in `fc_replies`.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mkdaemon.config.sim import GasLaw
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.sim.boards import fc_replies
from mkdaemon.sim.boards.aircraft import Aircraft
from mkdaemon.sim.boards.display import FcMenu
from mkdaemon.sim.boards.eeprom import Eeprom
from mkdaemon.sim.boards.external import ExternalControl
from mkdaemon.sim.boards.fc_commands import handle
from mkdaemon.sim.boards.flight import FlightCore
from mkdaemon.sim.boards.generations import FC_MS, SLOW_TICK_S, FcGeneration
from mkdaemon.sim.boards.gestures import Gesture
from mkdaemon.sim.boards.line import FC_CHAR_S, BoardPort
from mkdaemon.sim.boards.motors import MotorBench
from mkdaemon.sim.boards.parameters import Parameters
from mkdaemon.sim.boards.reception import FcReceiver
from mkdaemon.sim.world import DT, MOTORS_OFF

BOOT_S: Final = 5.0
"""From reset to the first handled frame."""
RESET_S: Final = 0.25
"""From `R` to the watchdog's reset."""
CALIBRATE_BUSY_S: Final = 1.5
SUBSCRIPTION_S: Final = 4000 * 1.025e-3
"""Streams stop so long after the last renewal: 4.1 s as measured."""
_SHORT_PASS_S: Final = 1.95e-3
_LONG_PASS_S: Final = 2.38e-3
_LONG_SHARE: Final = 0.3
"""Three of ten passes are long: mean 2.08 ms, and the measured loss of the second of two frames against their gap."""
_ACTUATION_S: Final = 0.5e-3
"""From the pass after sticks were evaluated to the set points on the motor bus."""
_COMPASS_S: Final = 0.099
_COMPASS_SLOW_S: Final = 0.999
"""Period of the compass feed without and with a NaviCtrl. Source: docs/protocol.md, section 9."""
_BANNER: Final = "\r\n\r\nFlight-Ctrl HW:{hardware} SW:{release}\r\nreceiver: PPM\r\nACC neutral: {neutral}\r\n"


@dataclass(slots=True)
class Stream:
    """A subscription."""

    interval: int = 0
    due: float = 0.0

    def restart(self, now: float) -> None:
        """Begin a period at `now`."""
        self.due = now + (10 * self.interval + 1) * FC_MS + _SHORT_PASS_S

    def is_due(self, now: float) -> bool:
        """Whether a frame must go out."""
        return self.interval > 0 and now >= self.due


@dataclass(slots=True)
class Wanted:
    """Replies asked for and not yet sent, one slot each; None and False mean nothing is wanted."""

    version: int | None = None
    control: bool = False
    debug: bool = False
    label: int | None = None
    display: bool = False
    menu: int | None = None
    receiver: bool = False


class FlightCtrl(BoardPort):
    """One FlightCtrl.

    Attributes:
        generation: its release.
        is_fork: the public fork: its gas law, its commands x e r o, its endless debug stream.
        live: the parameter set in RAM.
        has_companion: a NaviCtrl is on its SPI bus.
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
        super().__init__(FC_CHAR_S)
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
        self._gas_law = gas_law
        self._rng = random.Random(f"{seed} fc")
        self._next_pass = self._rng.uniform(0.0, _SHORT_PASS_S)
        self._begin(calibrated=calibrated)
        self._apply_gains()

    def _begin(self, *, calibrated: bool) -> None:
        """State that a reset loses."""
        self.core = FlightCore(self.generation, self.external, self.aircraft, calibrated=calibrated)
        self.rx = FcReceiver(self.generation.buffer)
        self.wanted = Wanted()
        self.debug = Stream()
        self.attitude = Stream()
        self.display = Stream()
        self.serial_channels = [-127] * 12
        self.forced_heading: int | None = None
        self.bridged = False
        self._expires = 0.0
        self._blocked_until = 0.0
        self._next_tick = self.now
        self._compass_at = self.now
        self._reset_at: float | None = None
        self._sticks = self._next_sticks = MOTORS_OFF
        self._sticks_at = 0.0

    # --- time ---

    def advance(self, to: float) -> None:
        """Run to `to` [s]."""
        while self._next_pass <= to:
            now = self._next_pass
            is_long = self._rng.random() < _LONG_SHARE
            self._next_pass = now + (_LONG_PASS_S if is_long else _SHORT_PASS_S)
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
            self._talk(now)
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
            self._next_tick += SLOW_TICK_S
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
            self.block(now + CALIBRATE_BUSY_S)
        self._command()

    def _command(self) -> None:
        sticks = self.core.stick_input(self.live)
        if sticks != self._next_sticks:
            self._next_sticks = sticks
            self._sticks_at = self._next_pass + _ACTUATION_S

    # --- talking ---

    def _talk(self, now: float) -> None:
        """Start at most one frame; a label asked for while a debug frame starts collides with it."""
        wanted = self.wanted
        if now >= self._expires:
            self.attitude.interval = self.display.interval = 0
            if not self.is_fork:
                self.debug.interval = 0
        if self._talk_first(now) or self._feed_compass(now):
            return
        started = False
        if wanted.debug or self.debug.is_due(now):
            wanted.debug = False
            self.debug.restart(now)
            self.send(fc_replies.debug(self), now)
            started = True
        if wanted.label is not None:
            index, wanted.label = wanted.label, None
            self._out.cut(now)
            self.send(fc_replies.name(index), now)
            return
        if not started:
            self._talk_last(now)

    def _talk_first(self, now: float) -> bool:
        """Version and external control go before everything."""
        wanted = self.wanted
        if wanted.version is not None:
            reply = fc_replies.companion_version if wanted.version == 2 else fc_replies.version
            wanted.version = None
            self.send(reply(self), now)
            return True
        if wanted.control:
            wanted.control = False
            self.send(fc_replies.control_state(self), now)
            return True
        return False

    def _feed_compass(self, now: float) -> bool:
        """Early firmware tells an MK3Mag its attitude, whether there is one or not."""
        if not self.generation.feeds_compass or now < self._compass_at:
            return False
        self._compass_at = now + (_COMPASS_SLOW_S if self.has_companion else _COMPASS_S)
        self._out.send(fc_replies.compass_feed(self).to_frame(Board.MAG), now)
        return True

    def _talk_last(self, now: float) -> None:
        """What a fast debug stream starves."""
        wanted = self.wanted
        if self.external.confirm:
            self.send(fc_replies.confirm(self.external.confirm), now)
            self.external.confirm = 0
        elif self.attitude.is_due(now):
            self.attitude.restart(now)
            self.send(fc_replies.attitude(self), now)
        elif wanted.display or self.display.is_due(now):
            wanted.display = False
            self.display.restart(now)
            self.send(self.menu.display(self), now + self.menu.PRINT_S)
        elif wanted.menu is not None:
            page, wanted.menu = wanted.menu, None
            self.send(self.menu.page(self, page), now + self.menu.PRINT_S)
        elif wanted.receiver:
            wanted.receiver = False
            self.send(fc_replies.receiver(self), now)

    def send(self, message: WireMessage, at: float) -> float:
        """Put a message on the line at `at` [s] or behind the frame leaving; return when it is out [s]."""
        return self._out.send(message.to_frame(Board.FC), at)

    def send_when_free(self, message: WireMessage, at: float) -> None:
        """As replies that wait for the transmitter inside their command: the loop stands still meanwhile."""
        busy = self._out.busy_until
        self.send(message, max(at, busy))
        self.block(max(at, busy))

    # --- what commands do ---

    def block(self, until: float) -> None:
        """The main loop is busy until then [s]: frames are not handled, one is kept."""
        self._blocked_until = max(self._blocked_until, until)

    def renew(self, now: float) -> None:
        """Keep the subscriptions alive."""
        self._expires = now + SUBSCRIPTION_S

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
            self._reset_at = at + RESET_S

    def reboot(self, now: float) -> None:
        """Reset: motors off, everything volatile lost, five seconds until the next frame is handled."""
        self.external.clear()
        self.now = now
        self._out.cut(now)
        self.load(self.eeprom.active)
        self._begin(calibrated=False)
        self.block(now + BOOT_S)
        banner = _BANNER.format(hardware="2.2", release=self.generation.label, neutral="ok")
        self._out.send(banner.encode("ascii"), now + 0.1)

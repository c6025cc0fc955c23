"""The FlightCtrl: one loop pass every 2 ms, one receive buffer, one frame leaving at a time.

`receive` takes characters with the time they were put on the line, `advance` runs the board to a time, `poll` returns
characters with the time their stop bit was out. Nothing here knows real time. Behaviour and figures:
docs/firmware-notes. The board's state is in `fc_board`, its commands in `fc_commands`, its replies in `fc_replies`, and
which frame leaves next in `fc_transmit`.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Final

from mksim.boards.aircraft import Aircraft
from mksim.boards.boot_text import boot_text
from mksim.boards.fc_board import FcBoard
from mksim.boards.fc_commands import handle
from mksim.boards.fc_transmit import start_next_frame
from mksim.boards.generations import (
    LONG_PASS,
    LONG_SHARE,
    LONGEST_PASS,
    LONGEST_SHARE,
    SHORT_PASS,
    SLOW_TICK,
    FcGeneration,
)
from mksim.boards.gestures import Gesture
from mksim.config import GasLaw
from mksim.physics.world import DT, MOTORS_OFF

BOOT: Final = 4.7
"""From reset to the first handled frame."""
BOOT_DEAD_MAN: Final = 6.75
"""From reset to the first count of the dead-man: a stick frame kept through the boot acts from 4.7 to 8.8 s."""
RESET: Final = 0.25
"""From `R` to the watchdog's reset."""
CALIBRATE_BUSY: Final = 1.5
_ACTUATION: Final = 0.5e-3
"""From the pass after sticks were evaluated to the set points on the motor bus."""


class FlightCtrl(FcBoard):
    """One FlightCtrl."""

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
        super().__init__(
            generation,
            aircraft,
            gas_law=gas_law,
            eeprom=eeprom,
            gate_parameter=gate_parameter,
            calibrated=calibrated,
        )
        self._rng = random.Random(f"{seed} fc")
        self._next_pass = self._rng.uniform(0.0, SHORT_PASS)
        self._reset_loop()

    def _reset_loop(self) -> None:
        self._next_tick = self.now
        self._reset_at: float | None = None
        self._sticks = self._next_sticks = MOTORS_OFF
        self._sticks_at = 0.0

    def advance(self, to: float) -> None:
        """Run to `to` [s]."""
        while self._next_pass <= to:
            now = self._next_pass
            self._next_pass = now + self._pass_time()
            self.now = now
            self._pass(now)
        self._step_aircraft_to(to)
        self.now = to

    def _pass_time(self) -> float:
        drawn = self._rng.random()
        if drawn < LONG_SHARE:
            return LONG_PASS
        return LONGEST_PASS if drawn >= 1.0 - LONGEST_SHARE else SHORT_PASS

    def _pass(self, now: float) -> None:
        """One turn of the main loop."""
        self._step_aircraft_to(now)
        for at, byte in self._line.take(now):
            if not self.bridged and self.rx.take(byte) and self.rx.buffer.command == "R":
                self._request_reset(at)
        if self._reset_at is not None and now >= self._reset_at:
            self.reboot(now)
        if self.aircraft.faults.take("fc_reboot"):
            self.reboot(now)
        if now < self.blocked_until or self.bridged:
            return
        if self.keeps_buffer:
            self.keeps_buffer = False
            self.rx.release()
        self._run_slow_ticks(now)
        if self.core.is_due(now):
            self._evaluate(now)
        if self._out.busy_until <= now:
            start_next_frame(self, now)
        if self.rx.has_frame:
            handle(self, now)
            if not self.keeps_buffer:
                self.rx.release()

    def _step_aircraft_to(self, to: float) -> None:
        """Let the aircraft fly under the sticks in force."""
        aircraft = self.aircraft
        while aircraft.now + DT <= to:
            if self._next_sticks is not self._sticks and aircraft.now + DT > self._sticks_at:
                self._sticks = self._next_sticks
            aircraft.step(self._sticks)

    def _run_slow_ticks(self, now: float) -> None:
        while self._next_tick <= now:
            self._next_tick += SLOW_TICK
            self.core.tick(now, self.live)
            self.external.tick_until(now)
            self.motors.pass_time(now, running=self.core.running)
            self._set_sticks()

    def _evaluate(self, now: float) -> None:
        """A receiver frame: sample sticks, obey gestures, move the motors one pass later."""
        gesture = self.core.evaluate(now, self.live, may_start=self.companion_error == 0)
        if gesture is Gesture.CALIBRATE:
            if self.core.chosen is not None:
                self.eeprom.active = self.core.chosen
                self.load(self.core.chosen)
                self.eeprom.save()
            self.block(now + CALIBRATE_BUSY)
        self._set_sticks()

    def _set_sticks(self) -> None:
        sticks = self.core.stick_input(self.live)
        if sticks != self._next_sticks:
            self._next_sticks = sticks
            self._sticks_at = self._next_pass + _ACTUATION

    def _request_reset(self, at: float) -> None:
        """`R` acts in the receive interrupt."""
        self.rx.release()
        if not (self.generation.reset_gated and self.core.running):
            self._reset_at = at + RESET

    def reboot(self, now: float) -> None:
        """Reset: motors off, everything volatile lost; the first frame received meanwhile is handled after the boot."""
        self.external.clear()
        self.external.start_dead_man_at(now + BOOT_DEAD_MAN)
        self.now = now
        self._out.cut(now)
        self.load(self.eeprom.active)
        self.reset_state(calibrated=False)
        self._reset_loop()
        self.booted_at = now + BOOT
        self.block(self.booted_at)
        for after, text in boot_text(self.generation.label):
            self._out.send(text.encode("ascii"), now + after)

"""External control frames: numbered, confirmed, and remembered until they are taken back. Pure; driven with `now`."""

from __future__ import annotations

from collections import deque
from typing import Final

from mkdaemon.link.health import HealthMonitor
from mkdaemon.link.scheduler import Entry
from mkdaemon.link.traffic import Purpose
from mkdaemon.protocol.wire import Board, WireMessage

_CONFIRM_DELAY_S: Final = 0.01
"""A board free to send confirms within 5 ms; twice that, to be fair [s]."""


class ControlPath:
    """The way of external control frames to the board and of their confirmations back.

    Attributes:
        hidden: confirmations that could not be seen: a FlightCtrl keeps one number to confirm, so while it sends a long
            frame a newer number replaces the older one.
        last_command: the latest frame sent that the aircraft may still obey; None after a release.
    """

    def __init__(self, health: HealthMonitor) -> None:
        self.hidden = 0
        self.last_command: WireMessage | None = None
        self._health = health
        self._number = 0
        self._rx_busy: deque[tuple[float, float]] = deque(maxlen=16)

    def restart(self) -> None:
        """A port was opened or lost.

        The last command is forgotten: minutes may have passed, and repeating its throttle, even with level sticks, is
        no way to let go.
        """
        self.last_command = None
        self._rx_busy.clear()

    def entry(self, message: WireMessage, purpose: Purpose, deadline: float, *, tag: object = None) -> Entry:
        """Number a frame (never 0: that would ask for no confirmation) and make it ready to send."""
        self._number = self._number % 255 + 1
        numbered = message.model_copy(update={"frame": self._number})
        return Entry(numbered.to_frame(), purpose, deadline, Board.FC, numbered, reaches_fc=True, tag=tag)

    def sent(self, entry: Entry, now: float, *, confirms: bool) -> int:
        """A frame went out; returns its number."""
        number: int = entry.message.frame  # type: ignore[union-attr]  # every layout of external control has it
        if confirms:
            self._health.confirm.sent(number, now)
        if entry.purpose is Purpose.SETPOINT:
            self.last_command = entry.message
        return number

    def board_was_busy(self, began: float, ended: float) -> None:
        """Another frame occupied the board's transmitter for this time [s]."""
        self._rx_busy.append((began, ended))

    def confirmed(self, number: int, now: float) -> None:
        """A confirmation came; older numbers it may have replaced are counted as hidden, not as lost."""
        began = self._health.confirm.began(number)
        if began is not None:
            for older, sent in self._health.confirm.before(began):
                if any(start < began + _CONFIRM_DELAY_S and end > sent for start, end in self._rx_busy):
                    self._health.confirm.forget(older)
                    self.hidden += 1
        self._health.confirmed(number, now)

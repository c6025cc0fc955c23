"""External control frames: numbered, confirmed, and remembered until they are taken back. Pure; driven with `now`."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass
from typing import Final

from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.scheduler import Entry
from mkdaemon.link.session.traffic import UNNUMBERED, BuildControl, FrameNumber, Purpose
from mkdaemon.protocol.wire import Board, WireMessage

_CONFIRM_DELAY: Final = 0.008
"""From the beginning of an external control frame to that of its confirmation, the board being free [s]: 3.1 ms on the
wire and 5 ms in the board."""
_RADIO: Final = 0.01
"""Answers later than over a cable by this much come by radio [s]."""
_PAUSE: Final = 0.005
"""A FlightCtrl begins its next frame up to this long after the last one [s]: one or two passes of its main loop."""
_TOLERANCE_TIME: Final = 0.003
"""Times at the host and at the board differ by about this much, and by the line's jitter [s]."""


@dataclass(slots=True, eq=False)
class ControlEntry(Entry):
    """An external control frame waiting for its turn.

    Attributes:
        number: of the frame.
    """

    number: FrameNumber = UNNUMBERED


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
        self._number = FrameNumber(0)
        self._rx_busy: deque[tuple[float, float]] = deque(maxlen=16)

    def restart(self) -> None:
        """A port was opened or lost.

        The last command is forgotten: minutes may have passed, and repeating its throttle, even with level sticks, is
        no release.
        """
        self.last_command = None
        self._rx_busy.clear()

    def entry(self, build: BuildControl, purpose: Purpose, deadline: float, *, tag: object = None) -> ControlEntry:
        """Build the next frame with its number, ready to send."""
        self._number = FrameNumber(self._number % 255 + 1)
        message = build(self._number)
        return ControlEntry(
            message.to_frame(), purpose, deadline, Board.FC, message, reaches_fc=True, tag=tag, number=self._number
        )

    def sent(self, entry: ControlEntry, now: float, *, confirms: bool) -> None:
        """A frame went out."""
        if confirms:
            self._health.confirm.sent(entry.number, now)
        if entry.purpose is Purpose.SETPOINT:
            self.last_command = entry.message

    def board_was_busy(self, began: float, ended: float) -> None:
        """Another frame occupied the board's transmitter for this time [s]; frames on end are one stretch."""
        if self._rx_busy and began - self._rx_busy[-1][1] < _PAUSE:
            began = self._rx_busy.pop()[0]
        self._rx_busy.append((began, ended))

    def confirmed(self, number: FrameNumber, now: float) -> None:
        """A confirmation came; older numbers it replaced before they could be sent are hidden, not lost."""
        confirm = self._health.confirm
        began = confirm.began(number)
        if began is not None:
            # How much later than over a cable an answer comes here: what the radio takes, there and back.
            delay = max(0.0, confirm.fastest - _CONFIRM_DELAY)
            waiting = [*confirm.before(began), (number, began)]
            for (older, sent), (_, replaced) in itertools.pairwise(waiting):
                # A radio bunches frames: two may arrive together however far apart they were sent.
                spread = confirm.jitter * (3.0 if delay > _RADIO else 1.0)
                if self._was_hidden(sent + delay, replaced + delay, _TOLERANCE_TIME + spread):
                    confirm.forget(older)
                    self.hidden += 1
        self._health.confirmed(number, now)

    def _was_hidden(self, sent: float, replaced: float, unsure: float) -> bool:
        """Whether one stretch kept the board's transmitter busy from one external control frame to the next."""
        first, last = sent + _CONFIRM_DELAY + unsure, replaced + _CONFIRM_DELAY - unsure
        return any(start < first and end > last for start, end in self._rx_busy)

"""A board that confirms stick frames, for rigs that fly the flight core over the line of `lab.control.rig`."""

from __future__ import annotations

import math
from typing import Any, Final

from mkdaemon.control.events import FrameConfirmed, FrameSent

CONFIRMED_AFTER: Final = 0.03
"""From a frame's arrival at the board until its confirmation is heard [s]: 5 ms of the board, and the way back."""
NUMBERS: Final = 255
"""Numbers of stick frames; they come again."""


class ConfirmingBoard:
    """Mixed into a rig: every stick frame carries a number, and is confirmed unless a way is broken.

    Attributes:
        broken: when the uplink begins to be broken and when it is whole again [s].
        silent: the same of the downlink: neither confirmations nor attitudes come.
    """

    core: Any
    broken = (math.inf, math.inf)
    silent = (math.inf, math.inf)
    _number = 0

    def _send(self, sticks: Any, at: float) -> None:
        self._number = number = self._number % NUMBERS + 1
        self.core.feed(FrameSent(number), at)
        if self.broken[0] <= at < self.broken[1]:
            return
        super()._send(sticks, at)  # type: ignore[misc]  # of the rig it is mixed into
        self._at(at + CONFIRMED_AFTER, lambda now: self._confirm(number, now))  # type: ignore[attr-defined]

    def _confirm(self, number: int, at: float) -> None:
        if not self.silent[0] <= at < self.silent[1]:
            self.core.feed(FrameConfirmed(number), at)

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        if not self.silent[0] <= at < self.silent[1]:
            super()._hear(pitch, roll, yaw, at)  # type: ignore[misc]

"""Sticks as the client sends them."""

from __future__ import annotations

from typing import ClassVar

from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.level import ByHand


class Stick(ByHand):
    """Sticks are what they are."""

    kind: ClassVar[str] = "stick"
    waits: ClassVar[str] = "waiting for neutral sticks"

    def _sticks(self) -> Sticks:
        wanted = self._wanted
        return Sticks(wanted.pitch, wanted.roll, wanted.yaw, wanted.throttle)

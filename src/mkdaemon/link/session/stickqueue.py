"""Whether the last stick frame has left the machine: no second one may wait behind it. Pure."""

from __future__ import annotations

from typing import Final

from mkdaemon.link.session.scheduler import Entry
from mkdaemon.link.session.traffic import Purpose

LOOK: Final = 0.005
"""Time between two looks at a stick frame that has not left [s]."""


class StickQueue:
    """Follows the last stick frame through the queues of the port and the kernel."""

    def __init__(self) -> None:
        self._behind: int | None = None

    @property
    def is_watching(self) -> bool:
        """Whether a stick frame was written that was still waiting at the last look."""
        return self._behind is not None

    def written(self, entry: Entry) -> None:
        """A frame was written."""
        if entry.purpose is Purpose.SETPOINT:
            self._behind = 0
        elif self._behind is not None:
            self._behind += len(entry.raw)

    def has_left(self, backlog: int) -> bool:
        """Whether the last stick frame is out, where so many bytes wait [bytes]."""
        if self._behind is not None and backlog <= self._behind:
            self._behind = None
        return self._behind is None

    def forget(self) -> None:
        """What waited was thrown away, or the port was lost."""
        self._behind = None

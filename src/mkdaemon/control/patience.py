"""How long a client keeps its lease while the line is unusable."""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.telemetry.link import LinkState

SILENCE: Final = 0.65
"""How long a client keeps its lease on a line on which nothing arrives [s]. Silence is reported after 0.35 s: the lease
ends one second after the last frame, as it does on a line that does not hear us. A radio that loses 15 % each way in
bursts is silent for half a second in every fifth flight, and a release does not get through before it is heard again.
"""
IDLE: Final = 2.0
"""The same while the lease sends nothing, for a line that has a port [s]. Without stick frames only link tests prove
the line, and a radio that loses 15 % each way loses five of them in a row now and then. A board that restarts is silent
for 4.7 s: docs/firmware-notes, "Timing"."""


class LinePatience:
    """Watches the line for the holder of the lease.

    Without a board nobody flies, and not after a reopening either: what the board held is gone. Nor past a board that
    does not hear us: it drops external control by itself, and must not obey again without warning.
    """

    def __init__(self, *, one_way: float) -> None:
        """Start with a good line.

        Args:
            one_way: patience with a board that does not hear us [s].
        """
        self._one_way = one_way
        self._unusable_since = self._silent_since = math.inf
        self._openings = 0

    def lease_taken(self, openings: int) -> None:
        """Note which opening of the port a new lease stands on."""
        self._openings = openings

    def watch(self, link: LinkState, now: float) -> None:
        """Note since when the line is unusable, and since when it is silent; who hears nothing is not heard either."""
        self._unusable_since = math.inf if link.condition.is_usable else min(self._unusable_since, now)
        self._silent_since = math.inf if link.condition.hears_board else min(self._silent_since, now)

    def is_over(self, link: LinkState, now: float, *, is_idle: bool = False) -> bool:
        """Whether the lease must end because of the line; `is_idle`: it sends nothing."""
        has_port = link.condition.hears_board or link.condition.is_silent
        if link.openings != self._openings or not has_port:
            return True
        one_way, silence = (IDLE, IDLE) if is_idle else (self._one_way, SILENCE)
        return now - self._unusable_since >= one_way or now - self._silent_since >= silence

"""How long a client keeps its lease while the line is unusable."""

from __future__ import annotations

from typing import Final

from mkdaemon.telemetry.link import LinkCondition, LinkState

_PATIENCE: Final = {
    LinkCondition.DOWN: 0.0,
    LinkCondition.ABSENT: 0.0,
    LinkCondition.CLOSED: 0.0,
    LinkCondition.MUTE: 0.15,
    LinkCondition.GARBAGE: 0.15,
}
"""How long a client keeps its lease on such a line [s]. Silence is reported after 0.35 s; a radio that drops a burst of
packets and is heard again within half a second has lost no aircraft."""
IDLE_PATIENCE: Final = 2.0
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
        self._patience = {**_PATIENCE, LinkCondition.ONE_WAY: one_way}
        self._bad_since: float | None = None
        self._openings = 0

    def lease_taken(self, openings: int) -> None:
        """Note which opening of the port a new lease stands on."""
        self._openings = openings

    def watch(self, link: LinkState, now: float) -> None:
        """Note since when the line is unusable."""
        if link.condition not in self._patience:
            self._bad_since = None
        elif self._bad_since is None:
            self._bad_since = now

    def is_over(self, link: LinkState, now: float, *, is_idle: bool = False) -> bool:
        """Whether the lease must end because of the line; `is_idle`: it sends nothing."""
        if link.openings != self._openings:
            return True
        if self._bad_since is None:
            return False
        patience = self._patience[link.condition]
        if is_idle and patience:
            patience = max(patience, IDLE_PATIENCE)
        return now - self._bad_since >= patience

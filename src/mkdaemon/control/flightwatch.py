"""What ends a lease without anybody asking: a line that is unusable for too long, a receiver that is lost. Pure."""

from __future__ import annotations

from mkdaemon.control.authority import Authority
from mkdaemon.control.modes import Event
from mkdaemon.control.patience import LinePatience
from mkdaemon.control.vehicle import VehicleFacts


class FlightWatch:
    """Looks at the line and at the pilot's receiver, at each tick."""

    def __init__(self, authority: Authority, facts: VehicleFacts, patience: LinePatience) -> None:
        """Watch for the holder of the lease of `authority`."""
        self._authority, self._facts, self._patience = authority, facts, patience

    def look(self, now: float) -> None:
        """End the lease where the line or the receiver says so; the next tick releases the aircraft.

        A FlightCtrl without its receiver lands by itself and ignores stick frames: they must not take hold again, at
        whatever tilt, when the receiver is back. Source: docs/firmware-notes, "External control".
        """
        link = self._facts.link
        if link is not None:
            self._patience.watch(link, now)
        if self._authority.lease(now) is None:
            return
        if link is not None and self._patience.is_over(link, now):
            self._authority.end(Event.LINK_LOST, cause=f"{link.condition.value}: {link.reason}")
        elif self._facts.is_receiver_lost(now):
            self._authority.end(Event.RECEIVER_LOST)

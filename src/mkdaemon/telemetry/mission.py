"""What mission the aircraft holds, told by whoever put it there."""

from __future__ import annotations

from mkdaemon.telemetry.base import Stamped


class MissionEvent(Stamped):
    """A waypoint list was stored or cleared, and read back: `event/mission`."""

    action: str
    """`uploaded` or `cleared`."""
    count: int
    """Points the NaviCtrl holds now."""
    digest: str
    """SHA-256 of the list as stored, in hexadecimal; equal for equal lists, whichever file they came from."""
    source: str
    """File the mission came from; empty when cleared."""

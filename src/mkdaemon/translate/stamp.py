"""When and from where a frame came."""

from __future__ import annotations

from typing import NamedTuple

from mkdaemon.telemetry.base import Telemetry


class Stamp(NamedTuple):
    """Arrival of a frame.

    Attributes:
        t_monotonic: [s; monotonic].
        t_wall: [s; Unix time].
        source: board and message, for example `nc/osd`.
    """

    t_monotonic: float
    t_wall: float
    source: str


State = tuple[str, Telemetry]
"""Key without `mk/<vehicle>/`, and the value."""

"""When and from where a frame came."""

from __future__ import annotations

from typing import NamedTuple

from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry


class Origin(NamedTuple):
    """What every state value takes from its frame.

    Attributes:
        stamp: when the frame's last byte arrived.
        source: board and message, for example `nc/osd`.
    """

    stamp: Stamp
    source: str


State = tuple[str, Telemetry]
"""Key without `mk/<vehicle>/`, and the value."""

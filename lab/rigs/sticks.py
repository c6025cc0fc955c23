"""External control frames for links without a flight core."""

from __future__ import annotations

from collections.abc import Callable

from mkdaemon.link.session.traffic import BuildSetpoint
from mkdaemon.protocol.wire import WireMessage


def build_sticks(layout: type[WireMessage], **fields: int) -> BuildSetpoint:
    """Return what builds a valid frame in this layout, whatever the aircraft's is.

    It has sticks as on the wire, zero where not given, and the number it is told.
    """
    make: Callable[..., WireMessage] = layout
    sticks = {"pitch": 0, "roll": 0, "yaw": 0, "throttle": 0, "config": 1} | fields
    return lambda _, frame: make(**sticks, frame=frame)

"""External control frames for links without a flight core."""

from __future__ import annotations

from collections.abc import Callable

from mkdaemon.link.session.controlpath import BuildControl
from mkdaemon.protocol.wire import WireMessage


def build_sticks(layout: type[WireMessage], **fields: int) -> BuildControl:
    """Return what builds a valid frame: sticks as on the wire, zero where not given, and the number it is told.

    Args:
        layout: class of external control.
        fields: of the message.
    """
    make: Callable[..., WireMessage] = layout
    sticks = {"pitch": 0, "roll": 0, "yaw": 0, "throttle": 0, "config": 1} | fields
    return lambda frame: make(**sticks, frame=frame)

"""External control frames: built for links without a flight core, and found among bytes on the wire."""

from __future__ import annotations

from collections.abc import Callable

from mkdaemon.link.session.traffic import BuildSetpoint
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.wire import WireMessage


def build_sticks(layout: type[WireMessage], **fields: int) -> BuildSetpoint:
    """Return what builds a valid frame in this layout, whatever the aircraft's is.

    It has sticks as on the wire, zero where not given, and the number it is told.
    """
    make: Callable[..., WireMessage] = layout
    sticks = {"pitch": 0, "roll": 0, "yaw": 0, "throttle": 0, "config": 1} | fields
    return lambda _, frame: make(**sticks, frame=frame)


def first_words(written: bytes) -> str:
    """What bytes begin with: `release` for external control whose every bit is off, else the command letter."""
    for item in FrameDecoder().feed(written):
        if not isinstance(item, Frame):
            return "no frame"
        message = MessageDecoder().decode(item)
        if item.id != "b":
            return item.id
        return "release" if not any(item.payload[:4]) and getattr(message, "config", 0) == 0 else "sticks"
    return "nothing"


def last_words(written: bytes) -> str:
    """What bytes end with, as `first_words` says it."""
    frames = [item for item in FrameDecoder().feed(written) if isinstance(item, Frame)]
    return first_words(frames[-1].raw) if frames else "nothing"


def steering(written: bytes) -> int:
    """External control frames among these bytes that are no release."""
    frames = [item for item in FrameDecoder().feed(written) if isinstance(item, Frame) and item.id == "b"]
    return sum(first_words(frame.raw) != "release" for frame in frames)

"""Every frame on the line, as bytes and as a typed message.

The stamp is the moment the last byte arrived, or was handed to the port.
"""

from typing import Any

from mkdaemon.telemetry.base import Stamped


class RawFrame(Stamped):
    """Bytes that crossed the line: `raw/rx`, `raw/tx`."""

    sequence: int
    """Counts frames and losses of this direction; a gap is a loss on the bus."""
    raw: bytes
    """From `#` to CR, or what was dropped."""
    dropped: str | None = None
    """Why it is not a frame: `text`, `checksum`, `length`, `characters`; null for a good frame."""
    purpose: str | None = None
    """Why it was sent: `release`, `setpoint`, `request`, `subscription`, `echo`; null for received ones."""


class FrameSample(Stamped):
    """A decoded message as it came or went: `rx/<board>/<message>`, `tx/<board>/<message>`."""

    sequence: int
    """The same number as in `raw/rx` or `raw/tx`."""
    board: str
    """fc, nc, mag, osd, bl: the sender or the addressee; any: every board; other: no known board."""
    id: str
    """Command letter."""
    message: str
    """Name of the message."""
    layout: str | None
    """Which generation of it; null for an unknown message."""
    fields: Any
    """Integers as on the wire, by English name; an unknown message has `payload` and `reason`."""
    purpose: str | None = None
    """Why it was sent; null for received ones."""

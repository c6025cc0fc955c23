"""How a command ends, as its reply says it."""

from enum import StrEnum


class Status(StrEnum):
    """How a command ended."""

    ACCEPTED = "accepted"
    DENIED = "denied"
    BUSY = "busy"
    UNSUPPORTED = "unsupported"
    TIMEOUT = "timeout"
    NOT_OBSERVABLE = "not_observable"
    """Sent, but this board gives no sign by which success could be known."""

"""Results of a command, as in its reply."""

from enum import StrEnum


class Status(StrEnum):
    """Result of a command."""

    ACCEPTED = "accepted"
    DENIED = "denied"
    BUSY = "busy"
    UNSUPPORTED = "unsupported"
    TIMEOUT = "timeout"
    NOT_OBSERVABLE = "not_observable"
    """Sent, but this board gives no sign by which success could be known."""

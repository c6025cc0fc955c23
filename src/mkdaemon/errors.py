"""The exception tree: what the caller knows once one of these was raised.

::

    MkError
    ├── ProtocolError
    │   └── EncodeError            our value does not fit the wire
    ├── LinkError
    │   ├── LinkLostError          device gone or silent; retrying can help
    │   └── RequestTimeoutError    link alive, no reply
    ├── CommandRejectedError       understood and refused; carries token, reason and fix
    ├── LeaseLostError             the aircraft is no longer ours to fly
    ├── ManoeuvreError             not done in time, or aborted; the lease is still held
    ├── NotEngagedError            leased, but the daemon sends no sticks
    ├── SilenceError               a value that was waited for did not come
    ├── VisionError                an image, camera, calibration or target cannot be used
    └── ConfigError                found before any task starts

Bytes and images from outside never raise: they are dropped, counted and named. Only our own mistakes raise.
"""


class MkError(Exception):
    """Root of everything mkdaemon raises on purpose; `str(error)` is one line fit for a user."""


class ProtocolError(MkError):
    """A rule of the MikroKopter protocol was broken on our side."""


class EncodeError(ProtocolError):
    """A value does not fit its wire field: nothing was sent."""


class LinkError(MkError):
    """The serial line cannot do what was asked."""


class LinkLostError(LinkError):
    """The device is gone or silent; retrying can help."""


class RequestTimeoutError(LinkError):
    """The line is alive but the board did not answer in time, all retries used."""


class CommandRejectedError(MkError):
    """A request was understood and refused.

    Attributes:
        token: stable machine-readable word, for example `not_leased`.
        reason: one sentence saying why.
        fix: one sentence saying what the user can do.
    """

    def __init__(self, token: str, reason: str, fix: str) -> None:
        super().__init__(f"{token}: {reason} {fix}")
        self.token = token
        self.reason = reason
        self.fix = fix


class LeaseLostError(MkError):
    """The lease ended during the flight: another client took it, or the daemon released the aircraft; says why."""


class NotEngagedError(MkError):
    """The lease is held, but the daemon did not begin to send what is streamed."""


class ManoeuvreError(MkError):
    """A manoeuvre was not done in time, or aborted; the lease is still held."""


class SilenceError(MkError):
    """A value that was waited for did not come in time; names the key."""


class VisionError(MkError):
    """An image, camera, calibration or target cannot be used; says which and how to repair it."""


class ConfigError(MkError):
    """The configuration is wrong; names file, key and the fix. No task has been started."""

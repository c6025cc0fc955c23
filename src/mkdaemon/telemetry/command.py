"""Requests of clients by query, their answers, and refusals.

Every answer to a command is a map with `status`; a refusal adds a stable `token`, the `reason` and the `fix`, see
`telemetry.refusals`.
"""

from typing import Annotated, Any, Final, Literal

from pydantic import BeforeValidator, Field

from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.base import Command, Telemetry
from mkdaemon.telemetry.refusals import TOKENS
from mkdaemon.telemetry.status import Status


class CommandResult(Telemetry):
    """The answer to a command."""

    status: Status
    """How it ended."""
    token: str | None = None
    """Stable word of a refusal; docs/keys.md lists them all."""
    reason: str | None = None
    """Why it was refused, one sentence."""
    fix: str | None = None
    """What to do about it, one sentence."""
    reply: dict[str, Any] | None = None
    """What the board or the daemon answered; null where there is nothing to say."""
    reply_type: str | None = None
    """Schema of `reply`, `<Name>.v<N>`; a board's reply has the fields of that message, as on the wire."""
    duration: float | None = None
    """Time from the query's arrival to this answer [s]."""


def refused(error: CommandRejectedError) -> CommandResult:
    """Make the answer that carries a refusal."""
    refusal = TOKENS.get(error.token)
    status = refusal.status if refusal else Status.DENIED
    return CommandResult(status=status, token=error.token, reason=error.reason, fix=error.fix)


class LeaseRequest(Command):
    """Take, renew, give back or look at the lease: `do/lease`."""

    action: Literal["take", "renew", "release", "show", "probe"]
    """What to do; `probe` answers with an `echo` for the `take` that follows."""
    echo: str = Field(default="", max_length=32)
    """From the answer to `probe`: the daemon measures the path delay of this client by it."""
    holder: str = Field(default="", max_length=64, pattern=r"^[A-Za-z0-9._-]*$")
    """Name of the client; also the last chunk of its liveliness token `mk/<vehicle>/client/<holder>`. Empty: the daemon
    chooses one."""
    epoch: int | None = None
    """The lease to renew or give back."""
    secret: str = Field(default="", max_length=64)
    """From the answer to `take`; needed to renew and return the lease."""
    ttl: float | None = Field(default=None, ge=0.5, le=60)
    """Time the lease lives without renewal or setpoints, if shorter than configured [s]."""
    force: bool = False
    """Take the lease from another holder; its setpoints end at once."""
    use_remembered: bool = False
    """Confirms that a FlightCtrl that cannot be asked in flight is the one before the daemon started or the port was
    opened; the refusal `remembered_only` says which."""


LONGEST_REASON: Final = 200
"""Of a release or an abort [characters]."""
Reason = Annotated[
    str,
    BeforeValidator(lambda text: text[:LONGEST_REASON] if isinstance(text, str) else text),
    Field(max_length=LONGEST_REASON),
]
"""Why; a longer text is cut, so that no release is refused for it."""


class ReleaseRequest(Command):
    """Release the aircraft now: `do/release`. Every client may, with or without a lease."""

    reason: Reason = "asked for"
    """Published with the event; a longer text is cut, never refused."""


class AbortRequest(Command):
    """Stop the manoeuvre that is flown: `do/abort`. Every client may; the holder keeps the lease."""

    reason: Reason = "asked for"
    """Published with the event; a longer text is cut, never refused."""


class AcceptAircraftRequest(Command):
    """Confirm that the aircraft at a port that came back is the right one: `do/accept_aircraft`."""


class GainsRequest(Command):
    """Ask for model, gains and margins of the horizontal loop: `do/gains`."""


class PreflightRequest(Command):
    """Make every check before a flight: `do/preflight`."""


class RatesRequest(Command):
    """Ask for a telemetry stream at a rate, or just for the present rates: `do/rates`."""

    stream: str | None = None
    """Key of the message, for example `osd`, `attitude`, `debug`, `display`; null to look only."""
    interval: float | None = Field(default=None, ge=0, le=2.55)
    """Time between two frames [s]; 0 stops the stream; null to look only."""


class Rates(Telemetry):
    """The streams that are asked for: the answer to `do/rates`."""

    intervals: dict[str, float]
    """Time between two frames of each stream [s]."""


class LabelsRequest(Command):
    """Ask for the names of a board's debug channels: `do/labels`."""

    board: Literal["fc", "nc", "mag"]
    """Whose."""


class Labels(Telemetry):
    """Names of a board's debug channels, read once a firmware and kept: the answer to `do/labels`."""

    board: str
    """Whose."""
    names: tuple[str, ...]
    """By channel, 0..31."""

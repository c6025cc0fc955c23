"""What a client asks for by query, what it is told, and why it is refused.

Every answer to a command is a map with `status`; a refusal adds a stable `token`, the `reason` and the `fix`. All
refusals of the whole daemon stand in one table, so a client can know them all, and a test walks it.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any, Final, Literal, NamedTuple

from pydantic import Field

from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.base import Command, Telemetry


class Status(StrEnum):
    """How a command ended."""

    ACCEPTED = "accepted"
    DENIED = "denied"
    BUSY = "busy"
    UNSUPPORTED = "unsupported"
    TIMEOUT = "timeout"
    NOT_OBSERVABLE = "not_observable"
    """Sent, but this board gives no sign by which success could be known."""


class Refusal(NamedTuple):
    """One way to be refused; reason and fix may name `{words}` that the refusal fills in."""

    status: Status
    reason: str
    fix: str


REFUSALS: Final[dict[str, Refusal]] = {
    # the request itself
    "malformed": Refusal(
        Status.DENIED, "the request cannot be read: {detail}.", "Send a msgpack map; `mkctl send --help` shows fields."
    ),
    "bad_field": Refusal(
        Status.DENIED, "{name} does not take this: {detail}.", "`mkctl get schema/{name}.v1` shows fields and limits."
    ),
    "unknown_message": Refusal(
        Status.UNSUPPORTED, "{board} has no request {name!r}.", "Did you mean {near}? docs/protocol.md lists all."
    ),
    "unknown_verb": Refusal(Status.UNSUPPORTED, "there is no verb {name!r}.", "Did you mean {near}? See docs/keys.md."),
    "unsupported": Refusal(
        Status.UNSUPPORTED, "this firmware does not know {name}: {detail}.", "docs/protocol.md says who does."
    ),
    "read_only": Refusal(
        Status.DENIED, "the aircraft is read-only: {detail}.", "Connect a firmware this version knows; `mkctl status`."
    ),
    "discovering": Refusal(
        Status.BUSY,
        "the aircraft is not known yet: {detail}.",
        "The board is asked again every few seconds while telemetry says that the motors stand still; `mkctl status`.",
    ),
    "busy": Refusal(Status.BUSY, "{detail}.", "Try again when the first one has been answered."),
    "internal": Refusal(Status.DENIED, "the daemon failed on it: {detail}.", "This is a defect; see the daemon's log."),
    # the line
    "link_down": Refusal(
        Status.DENIED, "the link is {state}: {detail}.", "`mkctl health` shows the line; check cable, power, port."
    ),
    "timeout": Refusal(
        Status.TIMEOUT,
        "{board} did not answer {name}: {detail}.",
        "The boards never say no: check `mkctl health`, then whether docs/protocol.md lists a condition for {name}.",
    ),
    "line_budget": Refusal(Status.DENIED, "{detail}.", "Make the intervals longer, or stop a stream."),
    "no_such_stream": Refusal(Status.UNSUPPORTED, "{board} has no stream {name!r}.", "`mkctl rate` shows them."),
    "board_unreachable": Refusal(
        Status.DENIED, "{board} cannot be reached from here: {detail}.", "Connect to it, or redirect the line first."
    ),
    "no_reply": Refusal(Status.UNSUPPORTED, "{name} is never answered.", "Send it without waiting."),
    "recording": Refusal(Status.DENIED, "a recording plays: nobody listens.", "Connect an aircraft."),
    "not_redirectable": Refusal(
        Status.UNSUPPORTED, "the line cannot be passed through to {board}.", "Connect to that board directly."
    ),
    "motors_not_known_off": Refusal(
        Status.DENIED, "a redirection stops the NaviCtrl's telemetry and servos.", "Stop the motors first."
    ),
    "wrong_layout": Refusal(
        Status.DENIED, "this FlightCtrl takes another layout of external control.", "This is a defect; see the log."
    ),
    "releasing": Refusal(Status.BUSY, "a release is under way.", "Wait for its result."),
    # danger gate
    "not_enabled": Refusal(
        Status.DENIED, "{name} is off: {detail}.", "Set commands.{option} = true in the configuration, knowing why."
    ),
    "not_confirmed": Refusal(
        Status.DENIED, "{name} is dangerous: {detail}.", "Repeat the request with `confirm` set to {confirm!r}."
    ),
    "motors_running": Refusal(
        Status.DENIED, "motors are running, and {name} {detail}.", "Land, stop the motors, repeat."
    ),
    "motors_unknown": Refusal(
        Status.DENIED,
        "nobody knows whether motors run ({detail}), and {name} must not meet running motors.",
        "Subscribe to the NaviCtrl's OSD data (`mkctl rate osd 200ms`), or check the cable to the NaviCtrl.",
    ),
    "board_unproven": Refusal(
        Status.DENIED,
        "the last version reply does not prove that {board} is on the line ({detail}).",
        "`mkctl send version-request --board {board}` first; behind a NaviCtrl redirect the line.",
    ),
    "never": Refusal(Status.DENIED, "{name} is never sent for a client: {detail}.", "{instead}"),
    # authority
    "not_leased": Refusal(Status.DENIED, "nobody holds the lease.", "`mkctl lease take` first."),
    "lease_held": Refusal(
        Status.DENIED,
        "{holder} holds the lease for another {left:.1f} s.",
        "Ask the holder, or take it with `--force`.",
    ),
    "wrong_epoch": Refusal(
        Status.DENIED, "epoch {epoch} is not the lease's epoch {current}.", "Take a lease and use the epoch it returns."
    ),
    "stale_sequence": Refusal(
        Status.DENIED, "sequence {sequence} is not after {last}.", "Count sequence up from one setpoint to the next."
    ),
    "gate_shut": Refusal(
        Status.DENIED,
        "the FlightCtrl ignores stick frames: ExternalControl of its active set is {value}, not above 128.",
        "Put it on a switch of the transmitter: `mkctl settings edit external_control=poti1` (to poti8).",
    ),
    "gate_constant": Refusal(
        Status.DENIED,
        "no switch of the transmitter ends external control: ExternalControl of the active set is {value}, a constant.",
        "`mkctl settings edit external_control=poti1`, or set control.lease.allow_constant_gate = true, knowing why.",
    ),
    "no_control": Refusal(
        Status.DENIED, "external control is not possible: {detail}.", "`mkctl status` shows the firmware and the gate."
    ),
}
"""Every refusal by its token; docs/keys.md shows the same table."""


class _Words(dict[str, Any]):
    def __missing__(self, key: str) -> str:
        return f"({key})"


def refuse(token: str, **words: Any) -> CommandRejectedError:
    """Make the refusal `token`, its reason and fix filled in with `words`.

    Raises:
        KeyError: the token is not in the table.
    """
    refusal = REFUSALS[token]
    filled = _Words(words)
    return CommandRejectedError(token, refusal.reason.format_map(filled), refusal.fix.format_map(filled))


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
    """What the board or the daemon answered."""
    reply_type: str | None = None
    """Schema of `reply`, `<Name>.v<N>`; a board's reply has the fields of that message, as on the wire."""
    duration: float | None = None
    """Time from the query's arrival to this answer [s]."""


class LeaseRequest(Command):
    """Take, renew, give back or look at the lease: `do/lease`."""

    action: Literal["take", "renew", "release", "show"]
    """What to do."""
    holder: str = Field(default="", max_length=64, pattern=r"^[A-Za-z0-9._-]*$")
    """Who asks; also the last chunk of its liveliness token `mk/<vehicle>/client/<holder>`. Who gives the name of the
    holder takes its place; who gives none gets one of its own."""
    epoch: int | None = None
    """The lease to renew or give back."""
    ttl: float | None = Field(default=None, ge=0.5, le=60, strict=False)
    """Time the lease lives without renewal or setpoints, if shorter than configured [s]."""
    force: bool = False
    """Take it although another client holds it; that client's setpoints end at once."""


class ReleaseRequest(Command):
    """Let go of the aircraft now: `do/release`. Anyone may, with or without a lease."""

    reason: str = Field(default="asked for", max_length=200)
    """Published with the event."""


class RateRequest(Command):
    """Ask for a telemetry stream at a rate, or just for the present rates: `do/rate`."""

    stream: str | None = None
    """Key of the message, for example `osd`, `attitude`, `debug`, `display`; null to look only."""
    interval: float | None = Field(default=None, ge=0, le=2.55, strict=False)
    """Time between two frames [s]; 0 stops the stream; null to look only."""


class Rates(Telemetry):
    """The streams that are asked for: the answer to `do/rate`."""

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

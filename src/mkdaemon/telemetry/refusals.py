"""Why a command is refused: every refusal of the whole program, with its reason and its fix.

A client can know them all: docs/keys.md shows this table, and a test walks it.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Final, NamedTuple

from mkdaemon.errors import CommandRejectedError


class Status(StrEnum):
    """How a command ended."""

    ACCEPTED = "accepted"
    DENIED = "denied"
    BUSY = "busy"
    UNSUPPORTED = "unsupported"
    TIMEOUT = "timeout"
    NOT_OBSERVABLE = "not_observable"
    """Sent, but this board gives no sign by which success could be known."""


class Token(StrEnum):
    """Stable word of a refusal."""

    MALFORMED = "malformed"
    BAD_FIELD = "bad_field"
    UNKNOWN_MESSAGE = "unknown_message"
    UNKNOWN_VERB = "unknown_verb"
    UNSUPPORTED = "unsupported"
    READ_ONLY = "read_only"
    DISCOVERING = "discovering"
    BUSY = "busy"
    BAD_VALUE = "bad_value"
    FLYING = "flying"
    IN_FLIGHT_NEEDED = "in_flight_needed"
    MOTORS_STARTED = "motors_started"
    LIST_INCOMPLETE = "list_incomplete"
    LIVE_SET_OWED = "live_set_owed"
    JOURNAL_UNWRITABLE = "journal_unwritable"
    CANCELLED = "cancelled"
    NO_PROCEDURE = "no_procedure"
    PROCEDURE_FAILED = "procedure_failed"
    INTERNAL = "internal"
    LINK_DOWN = "link_down"
    TIMEOUT = "timeout"
    LINE_BUDGET = "line_budget"
    NO_SUCH_STREAM = "no_such_stream"
    BOARD_UNREACHABLE = "board_unreachable"
    NO_REPLY = "no_reply"
    RECORDING = "recording"
    NOT_REDIRECTABLE = "not_redirectable"
    MOTORS_NOT_KNOWN_OFF = "motors_not_known_off"
    WRONG_LAYOUT = "wrong_layout"
    RELEASING = "releasing"
    UNCONFIRMED = "unconfirmed"
    NOT_ENABLED = "not_enabled"
    NOT_CONFIRMED = "not_confirmed"
    MOTORS_RUNNING = "motors_running"
    MOTORS_UNKNOWN = "motors_unknown"
    BOARD_UNPROVEN = "board_unproven"
    NEVER = "never"
    NOT_LEASED = "not_leased"
    LEASE_HELD = "lease_held"
    WRONG_EPOCH = "wrong_epoch"
    STALE_SEQUENCE = "stale_sequence"
    NO_GUIDANCE = "no_guidance"
    GATE_SHUT = "gate_shut"
    GATE_CONSTANT = "gate_constant"
    NO_CONTROL = "no_control"


class Refusal(NamedTuple):
    """One way to be refused; reason and fix may name `{words}` that the refusal fills in."""

    status: Status
    reason: str
    fix: str


REFUSALS: Final[Mapping[str, Refusal]] = {
    # the request itself
    Token.MALFORMED: Refusal(
        Status.DENIED, "the request cannot be read: {detail}.", "Send a msgpack map; `mkctl send --help` shows fields."
    ),
    Token.BAD_FIELD: Refusal(
        Status.DENIED, "{name} does not take this: {detail}.", "`mkctl get schema/{name}.v1` shows fields and limits."
    ),
    Token.UNKNOWN_MESSAGE: Refusal(
        Status.UNSUPPORTED, "{board} has no request {name!r}.", "Did you mean {near}? docs/protocol.md lists all."
    ),
    Token.UNKNOWN_VERB: Refusal(
        Status.UNSUPPORTED, "there is no verb {name!r}.", "Did you mean {near}? See docs/keys.md."
    ),
    Token.UNSUPPORTED: Refusal(
        Status.UNSUPPORTED, "this firmware does not know {name}: {detail}.", "docs/protocol.md says who does."
    ),
    Token.READ_ONLY: Refusal(
        Status.DENIED, "the aircraft is read-only: {detail}.", "Connect a firmware this version knows; `mkctl status`."
    ),
    Token.DISCOVERING: Refusal(
        Status.BUSY,
        "the aircraft is not known yet: {detail}.",
        "The board is asked again every few seconds while telemetry says that the motors stand still; `mkctl status`.",
    ),
    Token.BUSY: Refusal(Status.BUSY, "{detail}.", "Try again when the first one has been answered."),
    Token.BAD_VALUE: Refusal(Status.DENIED, "{detail}.", "`mkctl settings show` lists names and values."),
    # procedures
    Token.FLYING: Refusal(
        Status.DENIED,
        "{name} and flying exclude each other, and control is {phase}.",
        "Give the lease back (`mkctl lease release`), stop the motors, repeat.",
    ),
    Token.IN_FLIGHT_NEEDED: Refusal(
        Status.DENIED,
        "{detail}, and {name} takes effect at once.",
        "Land and stop the motors, or repeat with `in_flight` (`--in-flight`), knowing what it does.",
    ),
    Token.MOTORS_STARTED: Refusal(
        Status.DENIED,
        "motors have started during {name}, or nobody knows any more: what was begun may be incomplete.",
        "Land, stop the motors, repeat.",
    ),
    Token.LIST_INCOMPLETE: Refusal(
        Status.DENIED,
        "{detail}; the board's list may be incomplete.",
        "Repeat the upload, or empty the list: `mkctl waypoints clear`.",
    ),
    Token.LIVE_SET_OWED: Refusal(
        Status.DENIED,
        "{verb} was cut off, and parameter set {slot}, live before it, is not proven to be live again, so {name} must "
        "wait: {detail}.",
        "Stop the motors: it is restored as soon as the FlightCtrl answers; `mkctl settings recover` looks after it.",
    ),
    Token.JOURNAL_UNWRITABLE: Refusal(
        Status.DENIED,
        "the live parameter set cannot be noted for the case that the daemon dies: {detail}.",
        "Make the folder writable, or set vehicle.state_folder in the configuration.",
    ),
    Token.CANCELLED: Refusal(
        Status.DENIED, "{name} was cancelled: {detail}.", "Repeat it; what was half written stays so until then."
    ),
    Token.NO_PROCEDURE: Refusal(
        Status.DENIED, "no such procedure is under way.", "`mkctl get event/progress` shows the last."
    ),
    Token.PROCEDURE_FAILED: Refusal(Status.DENIED, "{name} failed: {detail}.", "Check `mkctl health`, then repeat it."),
    Token.INTERNAL: Refusal(
        Status.DENIED, "the daemon failed on it: {detail}.", "This is a defect; see the daemon's log."
    ),
    # the line
    Token.LINK_DOWN: Refusal(
        Status.DENIED, "the link is {state}: {detail}.", "`mkctl health` shows the line; check cable, power, port."
    ),
    Token.TIMEOUT: Refusal(
        Status.TIMEOUT,
        "{board} did not answer {name}: {detail}.",
        "The boards never say no: check `mkctl health`, then whether docs/protocol.md lists a condition for {name}.",
    ),
    Token.LINE_BUDGET: Refusal(Status.DENIED, "{detail}.", "Make the intervals longer, or stop a stream."),
    Token.NO_SUCH_STREAM: Refusal(Status.UNSUPPORTED, "{board} has no stream {name!r}.", "`mkctl rate` shows them."),
    Token.BOARD_UNREACHABLE: Refusal(
        Status.DENIED, "{board} cannot be reached from here: {detail}.", "Connect to it, or redirect the line first."
    ),
    Token.NO_REPLY: Refusal(Status.UNSUPPORTED, "{name} is never answered.", "Send it without waiting."),
    Token.RECORDING: Refusal(Status.DENIED, "a recording plays: nobody listens.", "Connect an aircraft."),
    Token.NOT_REDIRECTABLE: Refusal(
        Status.UNSUPPORTED, "the line cannot be passed through to {board}.", "Connect to that board directly."
    ),
    Token.MOTORS_NOT_KNOWN_OFF: Refusal(
        Status.DENIED, "a redirection stops the NaviCtrl's telemetry and servos.", "Stop the motors first."
    ),
    Token.WRONG_LAYOUT: Refusal(
        Status.DENIED, "this FlightCtrl takes another layout of external control.", "This is a defect; see the log."
    ),
    Token.RELEASING: Refusal(Status.BUSY, "a release is under way.", "Wait for its result."),
    Token.UNCONFIRMED: Refusal(Status.BUSY, "the last release is not confirmed yet.", "Wait until it is, or 6 s."),
    # danger gate
    Token.NOT_ENABLED: Refusal(
        Status.DENIED, "{name} is off: {detail}.", "Set commands.{option} = true in the configuration, knowing why."
    ),
    Token.NOT_CONFIRMED: Refusal(
        Status.DENIED, "{name} is dangerous: {detail}.", "Repeat the request with `confirm` set to {confirm!r}."
    ),
    Token.MOTORS_RUNNING: Refusal(
        Status.DENIED, "motors are running, and {name} {detail}.", "Land, stop the motors, repeat."
    ),
    Token.MOTORS_UNKNOWN: Refusal(
        Status.DENIED,
        "nobody knows whether motors run ({detail}), and {name} must not meet running motors.",
        "Subscribe to the NaviCtrl's OSD data (`mkctl rate osd 200ms`), or check the cable to the NaviCtrl.",
    ),
    Token.BOARD_UNPROVEN: Refusal(
        Status.DENIED,
        "the last version reply does not prove that {board} is on the line ({detail}).",
        "`mkctl send version-request --board {board}` first; behind a NaviCtrl redirect the line.",
    ),
    Token.NEVER: Refusal(Status.DENIED, "{name} is never sent for a client: {detail}.", "{instead}"),
    # authority
    Token.NOT_LEASED: Refusal(Status.DENIED, "nobody holds the lease.", "`mkctl lease take` first."),
    Token.LEASE_HELD: Refusal(
        Status.DENIED,
        "{holder} holds the lease for another {left:.1f} s.",
        "Ask the holder, or take it with `--force`.",
    ),
    Token.WRONG_EPOCH: Refusal(
        Status.DENIED, "epoch {epoch} is not the lease's epoch {current}.", "Take a lease and use the epoch it returns."
    ),
    Token.STALE_SEQUENCE: Refusal(
        Status.DENIED, "sequence {sequence} is not after {last}.", "Count sequence up from one setpoint to the next."
    ),
    Token.NO_GUIDANCE: Refusal(
        Status.UNSUPPORTED, "nothing turns {name} into sticks: the daemon follows {known}.", "Stream one of these."
    ),
    Token.GATE_SHUT: Refusal(
        Status.DENIED,
        "the FlightCtrl ignores stick frames: ExternalControl of its active set is {value}, not above 128.",
        "Put it on a switch of the transmitter: `mkctl settings edit external_control=poti1` (to poti8).",
    ),
    Token.GATE_CONSTANT: Refusal(
        Status.DENIED,
        "no switch of the transmitter ends external control: ExternalControl of the active set is {value}, a constant.",
        "`mkctl settings edit external_control=poti1`, or set control.lease.allow_constant_gate = true, knowing why.",
    ),
    Token.NO_CONTROL: Refusal(
        Status.DENIED, "external control is not possible: {detail}.", "`mkctl status` shows the firmware and the gate."
    ),
}
"""Every refusal by its token; docs/keys.md shows the same table."""


class _Words(dict[str, Any]):
    def __missing__(self, key: str) -> str:
        return f"({key})"


def refuse(token: Token, **words: Any) -> CommandRejectedError:
    """Make the refusal `token`, its reason and fix filled in with `words`."""
    refusal = REFUSALS[token]
    filled = _Words(words)
    return CommandRejectedError(token, refusal.reason.format_map(filled), refusal.fix.format_map(filled))

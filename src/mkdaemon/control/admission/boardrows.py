"""Admission of requests to the boards and of procedures, and what protects a flight from both.

Source of the rules: docs/safety.md, "The output limiter".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.control.admission.beginnings import BoardRequest, Concern, Procedure, TakeLease
from mkdaemon.control.admission.row import Rows, Verdict, passed, stands, when
from mkdaemon.control.admission.situation import Situation
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.danger import Confirm
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Token, refuse

LONGEST_BEEP: Final = 2.5
"""Longest time that a buzzer request may make a FlightCtrl deaf [s]; the link allows for it."""

_REQUEST: Final = (Concern.REQUEST,)
_PROCEDURE: Final = (Concern.PROCEDURE,)
_BOTH: Final = (Concern.REQUEST, Concern.PROCEDURE)
_ALL: Final = (Concern.LEASE, Concern.REQUEST, Concern.PROCEDURE)

BUSY_ROWS: Final = Rows()
"""What keeps the boards busy."""
REQUEST_ROWS: Final = Rows()
"""What prevents a request to a board."""
PROCEDURE_ROWS: Final = Rows()
"""What prevents a procedure."""


@BUSY_ROWS.row(
    "confirmed procedure",
    _PROCEDURE,
    "it writes to a board, and the request lacks `confirm`",
    Token.NOT_CONFIRMED,
    is_early=True,
)
def _unconfirmed(now: Situation, wanted: Procedure) -> Verdict:
    if not wanted.unconfirmed:
        return passed()
    return stands(refuse(Token.NOT_CONFIRMED, name=f"do/{wanted.verb}", detail=wanted.unconfirmed, confirm=True))


@BUSY_ROWS.row(
    "stick frames",
    _BOTH,
    "it blocks stick frames or excludes flying, and a client holds or takes the lease",
    Token.FLYING,
    is_early=True,
)
def _stick_frames(now: Situation, wanted: BoardRequest | Procedure) -> Verdict:
    """Refuse what keeps stick frames from the aircraft during a flight, or while a client takes the lease."""
    is_harmless = not (wanted.is_alone if isinstance(wanted, Procedure) else wanted.is_slow and wanted.is_disturbing)
    if is_harmless or now.is_free:
        return passed()
    phase = Phase.LEASED if now.work.leases else now.phase
    name = wanted.verb if isinstance(wanted, Procedure) else wanted.title
    return stands(refuse(Token.FLYING, name=name, phase=phase.value))


@BUSY_ROWS.row(
    "live set",
    _ALL,
    "a live set must be proven first: before a lease, before a dangerous request to the FlightCtrl, and "
    "before a procedure that relies on it",
    Token.LIVE_SET_OWED,
    is_early=True,
)
def _owed(now: Situation, wanted: TakeLease | BoardRequest | Procedure) -> Verdict:
    owed = now.work.owed
    match wanted:
        case TakeLease():
            name = "a lease"
        case BoardRequest():
            name = "this request" if wanted.is_disturbing and wanted.is_to_flightctrl else ""
        case Procedure():
            name = wanted.verb if wanted.needs_live_set else ""
    if owed is None or not name:
        return passed()
    return stands(refuse(Token.LIVE_SET_OWED, name=name, slot=owed.slot, verb=owed.verb, detail=owed.detail))


@BUSY_ROWS.row(
    "procedure under way",
    _ALL,
    "a procedure is under way; a lease waits only for one that excludes flying, and a harmless request for none",
    Token.BUSY,
    is_early=True,
)
def _running(now: Situation, wanted: TakeLease | BoardRequest | Procedure) -> Verdict:
    running = now.work.running
    match wanted:
        case TakeLease():
            is_in_the_way = now.work.is_alone
        case BoardRequest():
            is_in_the_way = wanted.is_disturbing
        case Procedure():
            is_in_the_way = True
    if running is None or not is_in_the_way:
        return passed()
    who = f" for {running.holder}" if running.holder else ""
    return stands(refuse(Token.BUSY, detail=f"{running.verb}{who} is under way ({running.id})"))


@REQUEST_ROWS.row("known request", _REQUEST, "this firmware does not know it", Token.UNSUPPORTED)
def _known_request(now: Situation, wanted: BoardRequest) -> Verdict:
    refusal = refuse(Token.UNSUPPORTED, name=wanted.title, detail=wanted.unsupported)
    return when(refusal if wanted.unsupported else None)


@REQUEST_ROWS.row(
    "writable aircraft",
    _REQUEST,
    "it is dangerous, or writes settings, and the firmware is not known well enough",
    Token.READ_ONLY,
)
def _writable(now: Situation, wanted: BoardRequest) -> Verdict:
    return when(refuse(Token.READ_ONLY, detail=wanted.read_only) if wanted.read_only else None)


@REQUEST_ROWS.row("never sent", _REQUEST, "it is never sent", Token.NEVER)
def _never(now: Situation, wanted: BoardRequest) -> Verdict:
    danger = wanted.danger
    if danger is None or not danger.never:
        return passed()
    return stands(refuse(Token.NEVER, name=wanted.title, detail=danger.never, instead=danger.instead))


@REQUEST_ROWS.row("enabled", _REQUEST, "the configuration does not turn it on", Token.NOT_ENABLED)
def _enabled(now: Situation, wanted: BoardRequest) -> Verdict:
    danger = wanted.danger
    if danger is None or danger.switch is None or danger.switch in wanted.switches:
        return passed()
    return stands(refuse(Token.NOT_ENABLED, name=wanted.title, detail=danger.effect, option=danger.switch.value))


@REQUEST_ROWS.row(
    "motors that stand still",
    _REQUEST,
    "it needs motors off, but they run, or no recent telemetry shows their state",
    Token.MOTORS_RUNNING,
    Token.MOTORS_UNKNOWN,
    Token.LINK_DOWN,
)
def _stopped(now: Situation, wanted: BoardRequest) -> Verdict:
    danger, running = wanted.danger, _running_motors(now, wanted)
    if danger is None or not danger.stopped or running is False:
        return passed()
    if running is None:
        return stands(_silent_line(now) or refuse(Token.MOTORS_UNKNOWN, detail=f"{wanted.title} needs them stopped"))
    return stands(refuse(Token.MOTORS_RUNNING, detail=f"{wanted.title} needs them stopped: {danger.effect}"))


@REQUEST_ROWS.row(
    "confirmed request",
    _REQUEST,
    "it must be confirmed, always or while motors may run, and lacks `confirm`",
    Token.NOT_CONFIRMED,
)
def _confirmed(now: Situation, wanted: BoardRequest) -> Verdict:
    danger = wanted.danger
    if danger is None or wanted.is_confirmed or danger.confirm is Confirm.NO:
        return passed()
    if danger.confirm is Confirm.IN_FLIGHT and _running_motors(now, wanted) is False:
        return passed()
    return stands(refuse(Token.NOT_CONFIRMED, name=wanted.title, detail=danger.effect, confirm=True))


@REQUEST_ROWS.row(
    "buzzer", _REQUEST, f"it would make the FlightCtrl deaf for more than {LONGEST_BEEP:g} s", Token.DEAF_TOO_LONG
)
def _deaf(now: Situation, wanted: BoardRequest) -> Verdict:
    refusal = refuse(Token.DEAF_TOO_LONG, seconds=wanted.deaf_time, limit=LONGEST_BEEP)
    return when(refusal if wanted.deaf_time > LONGEST_BEEP else None)


@REQUEST_ROWS.row(
    "proven board",
    _REQUEST,
    "it needs a proven board, but the last version reply came from another one",
    Token.BOARD_UNPROVEN,
)
def _proven(now: Situation, wanted: BoardRequest) -> Verdict:
    if wanted.danger is None or not wanted.danger.proven or not wanted.unproven:
        return passed()
    return stands(refuse(Token.BOARD_UNPROVEN, board=wanted.board, detail=wanted.unproven))


def _running_motors(now: Situation, wanted: BoardRequest) -> bool | None:
    """Whether motors run; motors turned by a motor test do not prevent the next test."""
    is_own_doing = wanted.danger is not None and wanted.danger.turns_motors and now.is_testing_motors
    return False if now.motors_running and is_own_doing else now.motors_running


def _silent_line(now: Situation) -> CommandRejectedError | None:
    """The link's fault, if the motors are unknown because nothing arrives."""
    if now.link is not None and now.link.condition.hears_board:
        return None
    condition = LinkCondition.ABSENT if now.link is None else now.link.condition
    return refuse(Token.LINK_DOWN, state=condition.value, detail="" if now.link is None else now.link.reason)


@PROCEDURE_ROWS.row(
    "motors for a procedure",
    _PROCEDURE,
    "it excludes flying, and motors run, or no recent telemetry shows their state",
    Token.IN_FLIGHT_NEEDED,
    Token.MOTORS_RUNNING,
    Token.MOTORS_UNKNOWN,
    Token.LINK_DOWN,
)
def _standing(now: Situation, wanted: Procedure) -> Verdict:
    """A procedure that excludes flying begins with motors that are known to stand still."""
    running, name = now.motors_running, f"do/{wanted.verb}"
    if not wanted.is_alone or running is False:
        return passed()
    if running is None and (silent := _silent_line(now)) is not None:
        return stands(silent)
    if wanted.can_fly:
        found = "motors are running" if running else "it is not known whether motors run"
        return stands(refuse(Token.IN_FLIGHT_NEEDED, name=name, detail=found))
    detail = f"{name} needs them stopped"
    if running:
        return stands(refuse(Token.MOTORS_RUNNING, detail=detail))
    return stands(refuse(Token.MOTORS_UNKNOWN, detail=detail))

"""The phases of authority: one table of states, events, guards, actions and reasons.

`Authority` moves only along these rows, docs/modes.md is drawn from them, and a test walks every one. To add a mode,
add its phase, the events that lead to it and its rows. Source of the rules: docs/safety.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from mkdaemon.telemetry.control import Phase


class Trigger(StrEnum):
    """Events of authority."""

    TICK = "tick"
    """Time has passed, or a setpoint has arrived: the stream is judged."""
    LEASE_TAKEN = "lease_taken"
    """A client takes the lease."""
    LEASE_TAKEN_OVER = "lease_taken_over"
    """A client takes the lease from its holder."""
    LEASE_RETURNED = "lease_returned"
    """The holder gives the lease back."""
    RELEASE_REQUESTED = "release_requested"
    """A client asks for a release."""
    ABORT_REQUESTED = "abort_requested"
    """A client asks to stop the manoeuvre."""
    CLIENT_GONE = "client_gone"
    """The holder's liveliness token is gone."""
    LINK_LOST = "link_lost"
    """The link is unusable for too long, or the port was reopened."""
    CONTROL_IMPOSSIBLE = "control_impossible"
    """The aircraft takes no external control any more."""
    LINE_RELEASING = "line_releasing"
    """The link is releasing by itself, or waits for a release to be confirmed."""
    GUIDANCE_LOST = "guidance_lost"
    """The setpoint cannot be followed any more: the target has been out of sight for too long, for example."""
    FLIGHT_FINISHED = "flight_finished"
    """The setpoint has been followed to its end: the aircraft stands on the target."""
    BATTERY_LOW = "battery_low"
    """The battery has been low for a while."""
    STALLED = "stalled"
    """The daemon itself stood still for longer than a setpoint lives."""
    RECEIVER_LOST = "receiver_lost"
    """The FlightCtrl has lost the pilot's transmitter and lands by itself."""
    GUARD_ACTED = "guard_acted"
    """The guard has released the aircraft in the daemon's place."""
    RELEASE_DONE = "release_done"
    """The release is done, or queued as the first bytes after the line comes back."""


class Reaction(StrEnum):
    """Output of a transition."""

    NOTHING = "nothing"
    """No stick frame."""
    STICKS = "sticks"
    """The setpoint's sticks, through the limiter."""
    HOLD = "hold"
    """Sticks that hold the place, through the limiter; level at hover throttle where no target is in sight."""
    LAND = "land"
    """Sticks that land on the target, through the limiter; level at hover throttle while it is out of sight."""
    NEUTRAL = "neutral"
    """Neutral sticks at hover throttle, through the limiter."""
    RELEASE = "release"
    """The active release: neutral sticks, then `Config = 0` until it is confirmed."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """Facts that the guards of rows use.

    Attributes:
        is_held: a client holds the lease.
        is_silent: its holder has been silent for too long: setpoints count in flight, any sign of life before.
        is_live: its stream has lived for `lease.engage_after` at `lease.engage_rate` or faster, and still does.
        is_ready: a flight may begin with its newest setpoint: sticks are neutral, or the estimate is good enough.
        is_fresh: its newest setpoint is within its time to live.
        is_release_owed: another release was asked for since the last one began.
        can_land: a target is in sight to land on.
        is_unanswered: the aircraft does not answer its sticks.
        resumes: the newest setpoint ends the abort.
    """

    is_held: bool = False
    is_silent: bool = False
    is_live: bool = False
    is_ready: bool = False
    is_fresh: bool = False
    is_release_owed: bool = False
    can_land: bool = False
    is_unanswered: bool = False
    resumes: bool = False


@dataclass(frozen=True, slots=True)
class ModeGuard:
    """A condition of a row.

    Attributes:
        meaning: in words, for the documentation.
        holds: the condition itself.
    """

    meaning: str
    holds: Callable[[Conditions], bool]


ALWAYS: Final = ModeGuard("always", lambda now: True)
SILENT: Final = ModeGuard("the holder is silent for too long", lambda now: now.is_silent)
NOT_READY: Final = ModeGuard("the stream is live, no flight may begin with it", lambda n: n.is_live and not n.is_ready)
READY: Final = ModeGuard(
    "the stream is live and ready, its newest setpoint is fresh",
    lambda now: now.is_live and now.is_ready and now.is_fresh,
)
READY_BUT_OLD: Final = ModeGuard(
    "the stream is live and ready, its newest setpoint is too old",
    lambda now: now.is_live and now.is_ready and not now.is_fresh,
)
UNANSWERED: Final = ModeGuard("the aircraft does not answer its sticks", lambda now: now.is_unanswered)
ANSWERED: Final = ModeGuard("the flight has restarted", lambda now: now.is_fresh and not now.is_unanswered)
RESUMED: Final = ModeGuard("the newest setpoint ends the abort", lambda now: now.resumes and now.is_fresh)
RESUMED_UNANSWERED: Final = ModeGuard(
    "the newest setpoint ends the abort, the aircraft does not answer its sticks",
    lambda now: RESUMED.holds(now) and now.is_unanswered,
)
FRESH: Final = ModeGuard("the newest setpoint is fresh", lambda now: now.is_held and now.is_fresh)
TOO_OLD: Final = ModeGuard("the newest setpoint is too old", lambda now: now.is_held and not now.is_fresh)
CAN_LAND: Final = ModeGuard("a target is in sight", lambda now: now.can_land)
RELEASE_OWED: Final = ModeGuard("another release was asked for meanwhile", lambda now: now.is_release_owed)
HELD: Final = ModeGuard("a client holds the lease", lambda now: now.is_held)
NOT_HELD: Final = ModeGuard("no client holds the lease", lambda now: not now.is_held)


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table.

    Attributes:
        sources: phases it starts from.
        event: what happens.
        guard: what must hold besides; the first row of an event whose guard holds is taken.
        target: phase it leads to.
        reaction: what is sent.
        reason: one sentence for `control/status`; `{words}` are filled in, `{cause}` comes with the event.
        is_asked: it was requested; a release that was not requested is a failsafe.
    """

    sources: tuple[Phase, ...]
    event: Trigger
    guard: ModeGuard
    target: Phase
    reaction: Reaction
    reason: str
    is_asked: bool = False


_FREE, _LEASED, _FLYING, _STALE, _UNANSWERED, _ABORTED, _LANDING, _RELEASING = Phase
IN_FLIGHT: Final = tuple(phase for phase in Phase if phase.is_in_flight)
"""Phases in which stick frames are sent."""
_STREAMED: Final = tuple(phase for phase in Phase if phase.is_streamed)
_ABORTABLE: Final = tuple(phase for phase in Phase if phase.may_be_aborted)
_UNTIL_LANDING: Final = (_FLYING, _STALE, _ABORTED)
_HELD: Final = (_LEASED, *IN_FLIGHT)
_WAITING: Final = "{holder} holds the lease; waiting for a live, neutral stream"
_FLIES: Final = "{holder} flies"
_OLD: Final = "the setpoint is too old: neutral sticks"


def _release(event: Trigger, sources: tuple[Phase, ...], reason: str, *, is_asked: bool = False) -> Row:
    return Row(sources, event, ALWAYS, _RELEASING, Reaction.RELEASE, reason, is_asked)


ROWS: Final = (
    Row((_FREE, *_HELD), Trigger.LEASE_TAKEN, ALWAYS, _LEASED, Reaction.NOTHING, _WAITING, is_asked=True),
    Row((_RELEASING,), Trigger.LEASE_TAKEN, ALWAYS, _RELEASING, Reaction.NOTHING, "{reason}", is_asked=True),
    Row(
        (_LEASED,), Trigger.TICK, SILENT, _RELEASING, Reaction.RELEASE, "no sign of life from {holder} for {silence} s"
    ),
    Row((_LEASED,), Trigger.TICK, NOT_READY, _LEASED, Reaction.NOTHING, "{holder} streams; {obstacle}"),
    Row((_LEASED,), Trigger.TICK, READY, _FLYING, Reaction.STICKS, _FLIES),
    Row((_LEASED,), Trigger.TICK, READY_BUT_OLD, _STALE, Reaction.NEUTRAL, _OLD),
    Row(IN_FLIGHT, Trigger.TICK, SILENT, _RELEASING, Reaction.RELEASE, "no setpoint from {holder} for {silence} s"),
    Row(_STREAMED, Trigger.TICK, UNANSWERED, _UNANSWERED, Reaction.NEUTRAL, "{obstacle}"),
    Row(_STREAMED, Trigger.TICK, FRESH, _FLYING, Reaction.STICKS, _FLIES),
    Row(_STREAMED, Trigger.TICK, TOO_OLD, _STALE, Reaction.NEUTRAL, _OLD),
    Row(_ABORTABLE, Trigger.ABORT_REQUESTED, ALWAYS, _ABORTED, Reaction.NOTHING, "aborted: {cause}", is_asked=True),
    Row((_UNANSWERED,), Trigger.TICK, ANSWERED, _FLYING, Reaction.STICKS, _FLIES),
    Row((_UNANSWERED,), Trigger.TICK, NOT_READY, _UNANSWERED, Reaction.NEUTRAL, "{holder} streams; {obstacle}"),
    Row((_UNANSWERED,), Trigger.TICK, ALWAYS, _UNANSWERED, Reaction.NEUTRAL, "{reason}"),
    Row((_ABORTED,), Trigger.TICK, RESUMED_UNANSWERED, _UNANSWERED, Reaction.NEUTRAL, "{obstacle}"),
    Row((_ABORTED,), Trigger.TICK, RESUMED, _FLYING, Reaction.STICKS, _FLIES),
    Row((_ABORTED,), Trigger.TICK, FRESH, _ABORTED, Reaction.HOLD, "{reason}"),
    Row((_ABORTED,), Trigger.TICK, TOO_OLD, _ABORTED, Reaction.NEUTRAL, "{reason}"),
    Row(_UNTIL_LANDING, Trigger.BATTERY_LOW, CAN_LAND, _LANDING, Reaction.NOTHING, "{cause} It lands on the target."),
    Row((_LANDING,), Trigger.TICK, FRESH, _LANDING, Reaction.LAND, "{reason}"),
    Row((_LANDING,), Trigger.TICK, TOO_OLD, _LANDING, Reaction.NEUTRAL, "{reason}"),
    _release(Trigger.BATTERY_LOW, _UNTIL_LANDING, "{cause} No target is in sight to land on: the pilot lands."),
    _release(Trigger.LEASE_TAKEN_OVER, (*_HELD, _RELEASING), "{taker} took the lease from {holder}", is_asked=True),
    _release(Trigger.LEASE_RETURNED, (*_HELD, _RELEASING), "{holder} gave the lease back", is_asked=True),
    _release(Trigger.RELEASE_REQUESTED, tuple(Phase), "{cause}", is_asked=True),
    _release(Trigger.CLIENT_GONE, (*_HELD, _RELEASING), "client {holder} is gone"),
    _release(Trigger.LINK_LOST, _HELD, "the link is {cause}"),
    _release(Trigger.CONTROL_IMPOSSIBLE, IN_FLIGHT, "external control is not possible: {cause}"),
    _release(Trigger.LINE_RELEASING, IN_FLIGHT, "{cause}"),
    _release(Trigger.GUIDANCE_LOST, IN_FLIGHT, "{cause}"),
    _release(Trigger.FLIGHT_FINISHED, IN_FLIGHT, "{cause}", is_asked=True),
    _release(Trigger.STALLED, IN_FLIGHT, "the daemon did not run for {cause} s"),
    _release(Trigger.RECEIVER_LOST, IN_FLIGHT, "the receiver is lost: the FlightCtrl ignores stick frames and lands"),
    _release(Trigger.GUARD_ACTED, tuple(Phase), "the guard released the aircraft: {cause}"),
    Row((_RELEASING,), Trigger.RELEASE_DONE, RELEASE_OWED, _RELEASING, Reaction.NOTHING, "{reason}"),
    Row((_RELEASING,), Trigger.RELEASE_DONE, HELD, _LEASED, Reaction.NOTHING, _WAITING),
    Row((_RELEASING,), Trigger.RELEASE_DONE, NOT_HELD, _FREE, Reaction.NOTHING, "{reason}"),
)
"""Every transition. A release takes effect at the next tick; what happens in between is judged from the same phase."""


def find_row(phase: Phase, event: Trigger, conditions: Conditions) -> Row | None:
    """Return the row an event takes from a phase; None where nothing changes.

    Args:
        phase: present one.
        event: what happened.
        conditions: what guards look at.
    """
    for row in ROWS:
        if row.event is event and phase in row.sources and row.guard.holds(conditions):
            return row
    return None

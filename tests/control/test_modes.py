"""The table of phases: every row by itself, what has no row, and what the table promises as a whole."""

from __future__ import annotations

import itertools
import string

import pytest

from mkdaemon.control.modes import (
    ALWAYS,
    ANSWERED,
    CAN_LAND,
    FRESH,
    HELD,
    NOT_HELD,
    NOT_READY,
    READY,
    READY_BUT_OLD,
    RELEASE_OWED,
    RESUMED,
    RESUMED_UNANSWERED,
    ROWS,
    SILENT,
    TOO_OLD,
    UNANSWERED,
    Conditions,
    Reaction,
    Trigger,
    find_row,
)
from mkdaemon.telemetry.control import Phase

WHEN = {
    ALWAYS: Conditions(),
    SILENT: Conditions(is_held=True, is_silent=True, is_fresh=True),
    NOT_READY: Conditions(is_held=True, is_live=True),
    READY: Conditions(is_held=True, is_live=True, is_ready=True, is_fresh=True),
    READY_BUT_OLD: Conditions(is_held=True, is_live=True, is_ready=True),
    FRESH: Conditions(is_held=True, is_fresh=True),
    CAN_LAND: Conditions(is_held=True, can_land=True),
    TOO_OLD: Conditions(is_held=True),
    UNANSWERED: Conditions(is_held=True, is_fresh=True, is_unanswered=True),
    ANSWERED: Conditions(is_held=True, is_fresh=True),
    RESUMED_UNANSWERED: Conditions(is_held=True, is_fresh=True, is_unanswered=True, resumes=True),
    RESUMED: Conditions(is_held=True, is_fresh=True, resumes=True),
    RELEASE_OWED: Conditions(is_held=True, is_release_owed=True),
    HELD: Conditions(is_held=True),
    NOT_HELD: Conditions(),
}
"""A situation in which each guard holds, and none of an earlier row."""

ALL = [Conditions(*flags) for flags in itertools.product((False, True), repeat=len(Conditions.__slots__))]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.event}-{row.sources[0]}-{row.target}")
def test_every_row_is_taken_from_each_of_its_phases(row):
    for phase in row.sources:
        assert find_row(phase, row.event, WHEN[row.guard]) is row


@pytest.mark.parametrize(
    ("phase", "event"),
    [
        (Phase.FREE, Trigger.TICK),
        (Phase.RELEASING, Trigger.TICK),
        (Phase.FREE, Trigger.CLIENT_GONE),
        (Phase.FREE, Trigger.LINK_LOST),
        (Phase.RELEASING, Trigger.LINK_LOST),
        (Phase.LEASED, Trigger.CONTROL_IMPOSSIBLE),
        (Phase.LEASED, Trigger.RELEASE_DONE),
        (Phase.FLYING, Trigger.RELEASE_DONE),
        (Phase.FREE, Trigger.ABORT_REQUESTED),
        (Phase.LEASED, Trigger.ABORT_REQUESTED),
        (Phase.ABORTED, Trigger.ABORT_REQUESTED),
    ],
)
def test_what_has_no_row_changes_nothing(phase, event):
    assert all(find_row(phase, event, situation) is None for situation in ALL)


def test_a_lease_that_is_neither_live_nor_silent_waits():
    assert find_row(Phase.LEASED, Trigger.TICK, Conditions(is_held=True, is_ready=True, is_fresh=True)) is None


@pytest.mark.parametrize("phase", Phase)
def test_sticks_are_sent_in_flight_only_and_a_stale_setpoint_never_tilts(phase):
    for situation in ALL:
        row = find_row(phase, Trigger.TICK, situation)
        if row is not None and row.reaction is Reaction.STICKS:
            assert row.target is Phase.FLYING
            assert situation.is_fresh
            assert not situation.is_silent
            assert phase is Phase.LEASED or not situation.is_unanswered
        if row is not None and row.reaction is Reaction.NEUTRAL:
            assert row.target in (phase, Phase.STALE, Phase.UNANSWERED)
            assert row.target is not Phase.FLYING
        if row is not None and row.reaction is Reaction.HOLD:
            assert row.target is Phase.ABORTED
            assert situation.is_fresh
        if row is not None and row.reaction is Reaction.LAND:
            assert row.target is phase is Phase.LANDING
            assert situation.is_fresh


def test_every_phase_can_be_released_by_anybody():
    for phase, situation in itertools.product(Phase, ALL):
        row = find_row(phase, Trigger.RELEASE_REQUESTED, situation)
        assert row is not None
        assert (row.target, row.reaction) == (Phase.RELEASING, Reaction.RELEASE)


def test_every_release_leads_to_releasing_and_nothing_else_does_but_a_release_under_way():
    for row in ROWS:
        if row.reaction is Reaction.RELEASE:
            assert row.target is Phase.RELEASING
        elif row.target is Phase.RELEASING:
            assert row.sources == (Phase.RELEASING,)


def test_every_event_and_reaction_is_used_and_every_reason_names_known_words():
    assert {row.event for row in ROWS} == set(Trigger)
    assert {row.reaction for row in ROWS} == set(Reaction)
    words = {name for row in ROWS for _, name, _, _ in string.Formatter().parse(row.reason) if name}
    assert words == {"holder", "silence", "taker", "cause", "reason", "obstacle"}


def test_of_guards_that_divide_a_situation_exactly_one_holds():
    """Held: fresh or too old. Live: not ready, ready, or ready but old."""
    for situation in ALL:
        assert FRESH.holds(situation) + TOO_OLD.holds(situation) == situation.is_held
        assert NOT_READY.holds(situation) + READY.holds(situation) + READY_BUT_OLD.holds(situation) == situation.is_live
        assert HELD.holds(situation) + NOT_HELD.holds(situation) == 1


def test_only_what_somebody_asked_for_is_no_failsafe():
    asked = {row.event for row in ROWS if row.is_asked}
    assert asked == {
        Trigger.LEASE_TAKEN,
        Trigger.LEASE_TAKEN_OVER,
        Trigger.LEASE_RETURNED,
        Trigger.RELEASE_REQUESTED,
        Trigger.ABORT_REQUESTED,
        Trigger.FLIGHT_FINISHED,
    }
    assert all(row.is_asked for row in ROWS if row.event in asked)

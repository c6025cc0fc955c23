"""What can begin: each names its concern, and says nothing but what it was made with."""

from __future__ import annotations

from typing import get_args

import pytest

from mkdaemon.control.admission.beginnings import (
    BY_HAND,
    BY_TARGET,
    MANOEUVRES,
    Beginning,
    BoardRequest,
    Concern,
    ListUpload,
    NaviGoto,
    NewManoeuvre,
    Procedure,
    StartRoute,
    TakeLease,
)
from mkdaemon.telemetry.danger import Confirm, Danger
from mkdaemon.telemetry.setpoint import SETPOINTS

EACH = {
    Concern.LEASE: TakeLease(),
    Concern.HOLD: NewManoeuvre(Concern.HOLD),
    Concern.REQUEST: BoardRequest(board="fc", name="beep"),
    Concern.PROCEDURE: Procedure(verb="settings_write"),
    Concern.UPLOAD: ListUpload(()),
    Concern.ROUTE: StartRoute(),
    Concern.NAVI_GOTO: NaviGoto(2.0),
}


def test_every_kind_of_beginning_is_one_and_names_its_concern():
    assert {type(beginning) for beginning in EACH.values()} == set(get_args(Beginning))
    assert {concern: beginning.concern for concern, beginning in EACH.items()} == {each: each for each in EACH}


@pytest.mark.parametrize("beginning", EACH.values(), ids=lambda beginning: type(beginning).__name__)
def test_who_says_nothing_asks_for_everything_that_is_looked_at(beginning):
    assert beginning.is_early is False
    is_set = {name: getattr(beginning, name, None) for name in (
        "force", "is_confirmed", "is_slow", "is_to_flightctrl", "is_step", "is_alone", "needs_live_set", "can_fly",
        "allow_unusual", "read_only", "unsupported", "unproven", "unconfirmed",
    )}  # fmt: skip
    assert not any(is_set.values())
    assert getattr(beginning, "deaf_time", 0.0) == 0.0


def test_manoeuvres_are_by_hand_or_by_the_target_and_each_has_its_setpoint():
    assert {concern.value for concern in MANOEUVRES} == {each.suffix.removeprefix("setpoint/") for each in SETPOINTS}
    assert [concern for concern in Concern if concern.is_by_target] == [c for c in MANOEUVRES if c not in BY_HAND]
    assert set(MANOEUVRES) == {*BY_HAND, *BY_TARGET}


DANGER = Danger(effect="it turns", confirm=Confirm.IN_FLIGHT)


@pytest.mark.parametrize(
    ("fields", "disturbs"),
    [
        ({}, False),
        ({"is_slow": True}, True),
        ({"danger": DANGER}, True),
        ({"danger": Danger(effect="it turns", confirm=Confirm.NO)}, False),
        ({"danger": DANGER, "is_step": True}, False),
        ({"is_slow": True, "is_step": True}, False),
    ],
)
def test_slow_and_dangerous_requests_disturb_unless_their_procedure_was_admitted(fields, disturbs):
    request = BoardRequest(board="fc", name="beep", **fields)
    assert request.is_disturbing is disturbs
    assert request.title == "fc/beep"

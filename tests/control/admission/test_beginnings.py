"""What can begin: each names its concern, and says nothing but what it was made with."""

from __future__ import annotations

import pytest

from mkdaemon.control.admission.beginnings import (
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

EACH = {
    Concern.LEASE: TakeLease(),
    Concern.HOLD: NewManoeuvre(Concern.HOLD),
    Concern.REQUEST: BoardRequest(board="fc", name="beep"),
    Concern.PROCEDURE: Procedure(verb="settings_write"),
    Concern.UPLOAD: ListUpload(()),
    Concern.ROUTE: StartRoute(),
    Concern.NAVI_GOTO: NaviGoto(2.0),
}


@pytest.mark.parametrize("beginning", EACH.values(), ids=lambda beginning: type(beginning).__name__)
def test_who_says_nothing_asks_for_everything_that_is_looked_at(beginning):
    assert beginning.is_early is False
    is_set = {name: getattr(beginning, name, None) for name in (
        "force", "is_confirmed", "is_slow", "is_to_flightctrl", "is_step", "is_alone", "needs_live_set", "can_fly",
        "allow_unusual", "read_only", "unsupported", "unproven", "unconfirmed",
    )}  # fmt: skip
    assert not any(is_set.values())
    assert getattr(beginning, "deaf_time", 0.0) == 0.0


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

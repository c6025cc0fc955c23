"""What the pilot's hands do: one sentence for every phase, and the throttle that caps ours before all others."""

from __future__ import annotations

import pytest

from mkdaemon.control.manoeuvres.land import LandingPhase
from mkdaemon.control.manoeuvres.take_off import TakeOffPhase
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.control.pilots_hands import CAPPED, HANDS, LID, pilots_hands
from mkdaemon.telemetry.control import Phase, Progress
from mkdaemon.telemetry.setpoint import SETPOINTS

KINDS = [kind.suffix.removeprefix("setpoint/") for kind in SETPOINTS]


@pytest.mark.parametrize("phase", Phase)
def test_every_phase_has_a_sentence_whatever_is_flown(phase):
    stages = ["", *(stage.value for stage in (*TakeOffPhase, *LandingPhase))]
    progresses = [None, *(Progress(kind, stage, is_done=False) for kind in KINDS for stage in stages)]
    assert all(pilots_hands(phase, progress, is_capped=False) for progress in progresses)


def test_no_row_is_hidden_by_one_before_it():
    for row in HANDS:
        progress = Progress(row.manoeuvre, row.stage, is_done=False) if row.manoeuvre else None
        assert pilots_hands(row.phase, progress, is_capped=False) == row.words
    assert {row.manoeuvre for row in HANDS} <= {"", *KINDS}


def test_a_throttle_that_caps_ours_comes_before_all_but_where_it_is_meant_to():
    hold = Progress("hold", "", is_done=False)
    assert pilots_hands(Phase.FLYING, hold, is_capped=False) == LID
    assert {phase for phase in Phase if pilots_hands(phase, hold, is_capped=True) == CAPPED} == set(IN_FLIGHT)
    for kind, stage in (("takeoff", TakeOffPhase.IDLE.value), ("land", LandingPhase.DOWN.value)):
        assert pilots_hands(Phase.FLYING, Progress(kind, stage, is_done=False), is_capped=True) != CAPPED


def test_after_a_landing_he_pulls_the_throttle_down_and_does_not_hover():
    stands = Progress("land", LandingPhase.DOWN.value, is_done=True)
    assert "throttle down" in pilots_hands(Phase.RELEASING, stands, is_capped=False)
    in_the_air = Progress("land", LandingPhase.DESCEND.value, is_done=False)
    assert "throttle back to hover" in pilots_hands(Phase.RELEASING, in_the_air, is_capped=False)

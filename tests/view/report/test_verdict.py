"""The head of a report: how the flight ended, and the chain of causes with its times."""

from __future__ import annotations

import pytest

from mkdaemon.view.report.happenings import MOST_TROUBLES, Trouble, take_causes
from mkdaemon.view.report.verdict import head_of
from tests.view.report.known import Tape, known_flight
from tests.view.report.test_pieces import read

POSE = {"kind": "no_pose", "text": "no pose for 1.0 s", "seconds": 1.0}


def causes(pose_age, refused=0):
    """The causes of a moment, as the flight core publishes them."""
    found = [{"kind": "no_pose", "text": f"no pose for {pose_age:.1f} s", "seconds": pose_age}]
    if refused:
        found.append({"kind": "refused", "text": f"{refused} poses refused off_course", "count": refused})
    found.append({"kind": "no_attitude", "text": f"attitude silent {pose_age + 0.4:.1f} s", "seconds": pose_age + 0.4})
    return found


def flight_of(*, released):
    """A hold: a trouble of 1.2 s that it outlives, and one that ends it at 44.8 s."""
    flown = {"phase": "flying", "manoeuvre": "hold", "reason": "ann flies"}
    tape = Tape((0.0, "state/altitude", {"above_start": 0.0}), (10.0, "control/status", flown))
    for tick in range(4):
        tape.add(20.0 + 0.2 * tick, "control/status", flown | {"causes": causes(0.6 + 0.2 * tick)})
    tape.add(20.8, "control/status", flown | {"causes": []})
    for tick in range(13 * released):
        reported = causes(0.6 + 0.2 * tick, refused=3 * tick)
        tape.add(42.4 + 0.2 * tick, "control/status", flown | {"causes": reported})
    end = {"phase": "releasing", "reason": "no image of pad for 3.0 s", "outcome": None}
    tape.add(44.8, "control/status", end if released else {**end, "reason": "landed on pad", "outcome": "landed"})
    if released:
        tape.add(45.0, "event/failsafe", {"action": "release", "reason": "no image", "released": True})
    tape.add(46.0, "control/status", {"phase": "free", "reason": "no image of pad for 3.0 s"})
    return read(tape)


def test_a_release_begins_with_its_chain_the_effect_first_each_with_its_time():
    head = head_of(flight_of(released=True))
    assert (head.text, head.is_bad) == ("FAILED at 44.8 s: no image of pad for 3.0 s.", True)
    times, texts = zip(*head.chain, strict=True)
    assert texts == (
        "no pose for 3.0 s",
        "36 poses refused off_course",
        "attitude silent 3.4 s",
        "survived: no pose for 1.2 s; attitude silent 1.6 s; ended at 20.8 s",
    )
    assert times == pytest.approx((41.8, 42.6, 41.4, 19.0), abs=0.01)


def test_a_flight_that_lands_says_so_with_the_trouble_that_it_outlived():
    head = head_of(flight_of(released=False))
    assert (head.text, head.is_bad) == ("Ended at 44.8 s: landed on pad (landed).", False)
    assert [text for _, text in head.chain] == ["survived: no pose for 1.2 s; attitude silent 1.6 s; ended at 20.8 s"]


def test_a_flight_that_goes_on_none_at_all_and_a_step_of_the_ladder_in_its_middle_are_no_release():
    assert not head_of(read(known_flight())).is_bad  # neutral for a moment at 5 s
    flying, output = {"phase": "flying", "manoeuvre": "hold"}, {"pitch": 1, "roll": 1, "yaw": 1, "throttle": 1}
    in_flight = Tape((0.0, "control/status", flying), (3.0, "control/output", output))
    assert head_of(read(in_flight)).text == "The recording ends in flight."
    assert head_of(read(Tape((0.0, "state/altitude", {"above_start": 1.0})))).text == "No automatic flight."


@pytest.mark.parametrize("strange", [None, "x", [], [None], [{"text": ""}], [3], {"kind": "no_pose"}])
def test_what_is_no_cause_is_none(strange):
    troubles = []
    take_causes(troubles, 1.0, {"causes": strange})
    assert troubles == []


def test_a_recording_of_many_troubles_keeps_the_first():
    troubles: list[Trouble] = []
    for tick in range(2 * MOST_TROUBLES + 4):
        take_causes(troubles, float(tick), {"causes": [POSE] if tick % 2 else []})
    assert len(troubles) == MOST_TROUBLES

"""What one report says of an answer, and when it says nothing: the numbers of docs/lab/control.md, worked out anew."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.control.answers import REACH, AnswerWatch
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.stickresponse import STEP
from mkdaemon.control.linear import discretise
from tests.control.estimator.test_stickresponse import by_equations

UPLINK = 0.05
MODEL = replace(AircraftModel(), uplink=UPLINK)
SHARES = np.array([0.5, 1.0, 2.0])
ROUGH = math.radians(1.0)


def believed(seconds, stick, first):
    """Believed tilt after a stick was held so long, of an aircraft that flew by the stick `first` [rad]."""
    f, g = discretise(*by_equations(MODEL), seconds)
    return (f @ np.array([first, 0.0, 0.0, first]) + g[:, 0] * stick)[0]


def swinging(reported, *, seconds=9.0, size=10.0, says_something=True):
    """A watch of sticks that swing, `size` counts wide, and what `reported(expected, now)` makes of it.

    It ends with the report at which nothing answers any more.

    Returns:
        The watch; of each report what was expected and what was reported (n, 2), (n, 2) [rad].
    """
    watch, expected, seen = AnswerWatch(MODEL), [], []
    for k in range(round(seconds / STEP)):
        now = k * STEP
        asked = size * np.array([math.sin(6.0 * now), math.cos(4.0 * now)])
        watch.sent(*asked, now)
        if k and k % 2 == 0:
            watch._advance(now)
            expected.append(watch.expected)
            seen.append(reported(watch.expected, now))
            watch.attitude_received(now, *seen[-1], says_something=says_something)
            if watch.is_missing:
                break
    return watch, np.array(expected), np.array(seen)


def unanswered():
    """A watch that has just found that nothing answers, and when [s]."""
    watch, _, seen = swinging(lambda asked, now: 0.0 * asked, size=30.0)
    assert watch.is_missing
    return watch, 0.02 * len(seen)


def evidence_of(expected, seen, step=0.02):
    """Log-likelihood that a share of what is expected is not in what was reported against that it is (3,) [nat]."""
    slow_of_expected, slow_of_seen, found = expected[0], seen[0], np.zeros(3)
    keep = math.exp(-step / 1.5)
    for asked, tilt in zip(expected, seen, strict=True):
        slow_of_expected = keep * slow_of_expected + (1.0 - keep) * asked
        slow_of_seen = keep * slow_of_seen + (1.0 - keep) * tilt
        for k, share in enumerate(SHARES):
            acts, left = share * (asked - slow_of_expected), tilt - slow_of_seen
            deviation = np.hypot(ROUGH, 0.25 * acts)
            without, with_it = -0.5 * (left / deviation) ** 2, -0.5 * ((left - acts) / deviation) ** 2
            found[k] += 5.0 * step * float((without - with_it).sum())
        found = found.clip(-2.0, 4.0)
    return found


def test_a_flight_begins_with_the_tilt_that_was_reported():
    watch = AnswerWatch(MODEL)
    watch.attitude_received(4.9, 0.1, -0.2, says_something=True)
    watch.sent(20.0, -10.0, 5.0)
    watch.attitude_received(5.05, 0.0, 0.0, says_something=True)
    assert watch.expected == pytest.approx([believed(0.05, 0.1, 0.1), believed(0.05, -0.2, -0.2)])


@pytest.mark.parametrize("later", [0.2, 0.6])
def test_sticks_act_after_the_line_and_until_the_next(later):
    watch = AnswerWatch(MODEL)
    watch.sent(20.0, -10.0, 5.0)
    watch.sent(20.0, -10.0, 5.25)
    watch.sent(20.0, -10.0, 5.5)
    watch.attitude_received(5.05 + later, 0.0, 0.0, says_something=True)
    tilt = believed(later, 20.0 * MODEL.rad_per_count, 0.0)
    assert watch.expected == pytest.approx([tilt, -0.5 * tilt], rel=1e-5)
    watch.sent(0.0, 0.0, 5.75)
    watch.sent(10.0, 0.0, 5.76)
    watch.attitude_received(5.85, 0.0, 0.0, says_something=True)
    parts = (believed(length, 1.0, 0.0) for length in (0.8, 0.05, 0.04))
    whole, level, half = (float(part) * 20.0 * MODEL.rad_per_count for part in parts)
    assert watch.expected[0] == pytest.approx(whole - level + 0.5 * half, rel=1e-5)


@pytest.mark.parametrize(
    ("reported", "size"),
    [
        (lambda asked, now: 0.0 * asked, 2.0),  # shut, before it is decided
        (lambda asked, now: 0.0 * asked, 30.0),
        (lambda asked, now: 0.24 * asked, 30.0),  # undecided
        (lambda asked, now: 0.26 * asked + 0.05, 30.0),
        (lambda asked, now: np.array([0.5 * asked[0], 0.0]), 10.0),
        (lambda asked, now: asked + 0.02 * np.array([math.sin(9.0 * now), 0.3]), 10.0),
    ],
)
def test_evidence_is_the_log_likelihood_of_the_fast_part(reported, size):
    """As soon as no share explains what is reported, nothing answers."""
    for seconds in (0.1, 0.3, 0.6, 1.2):
        watch, expected, seen = swinging(reported, seconds=seconds, size=size)
        least = evidence_of(expected, seen).min()
        if least >= 4.0:
            assert watch.is_missing
            return
        assert watch.evidence == pytest.approx(least, abs=1e-9)
        assert not watch.is_missing


def test_what_answers_is_sure_at_a_likelihood_of_2_and_no_more_of_it_is_kept():
    watch, _, _ = swinging(lambda asked, now: asked, seconds=0.1)
    assert -2.0 < watch.evidence < 0.0
    assert not watch.is_sure
    watch, _, _ = swinging(lambda asked, now: asked, seconds=2.0)
    assert watch.evidence == -2.0
    assert watch.is_sure


def test_an_answer_is_doubted_once_it_is_not_sure_any_more_and_not_before_it_was():
    watch, _, _ = swinging(lambda asked, now: asked, seconds=3.0, size=30.0)
    assert not watch.is_doubted
    for k in range(100):
        now, was = 3.0 + 0.02 * k, watch.evidence
        watch.sent(30.0 * math.sin(6.0 * now), 30.0 * math.cos(4.0 * now), now)
        watch.attitude_received(now, 0.0, 0.0, says_something=True)
        if watch.is_missing:
            break
        assert watch.is_doubted is (watch.evidence > -1.0)
    assert -1.0 < was < 4.0
    watch.forget()
    assert watch.is_doubted, "it came back, and has shown nothing since"
    undecided, _, _ = swinging(lambda asked, now: 0.24 * asked, seconds=0.5, size=30.0)
    assert undecided.evidence > -1.0
    assert not undecided.is_doubted


@pytest.mark.parametrize(
    ("lean_deg", "reports"),
    [((0.0, 0.0), 23), ((0.5, 0.0), 26), ((0.0, -0.7), 31), ((1.0, 0.0), 49), ((1.4, 0.0), None)],
)
def test_under_level_sticks_each_report_weighs_a_level_aircraft_against_one_flown_by_hand(lean_deg, reports):
    """Worked by hand: from 4 to -4 nat, by ln(3 / 0.5) - s2 (1 / 0.5^2 - 1 / 3^2) / 2 of each axis in 0.2 s."""
    watch, begin = unanswered()
    assert (watch.evidence, watch.is_sure) == (4.0, False)
    assert reports_until_back(watch, begin, np.radians(lean_deg)) == reports


def reports_until_back(watch, begin, lean=(0.0, 0.0)):
    """Reports of a lean under level sticks until the answer is believed to be back; None for more than 2 s of them."""
    for k in range(1, 101):
        now = begin + 0.02 * k
        watch.sent(0.0, 0.0, now)
        watch.attitude_received(now, *lean, says_something=True)
        if not watch.is_missing:
            assert watch.evidence == 0.0
            return k
    return None


@pytest.mark.parametrize(("answers_for", "reports"), [(0.0, [23, 34, 56]), (6.0, [23, 34, 23])])
def test_each_answer_that_came_back_and_was_none_asks_for_twice_as_much(answers_for, reports):
    """Worked by hand: 8, 12 and 20 nat of 3.58 in 0.2 s; 8 again where it has answered for more than 5 s."""
    watch, now = unanswered()
    found = []
    for pause in (0.0, answers_for, 0.0):
        found.append(reports_until_back(watch, now))
        now += 0.02 * found[-1]
        for k in range(1, 1000):
            at = now + 0.02 * k
            watch.sent(20.0 * math.sin(6.0 * at), 0.0, at)
            watch._advance(at)
            watch.attitude_received(at, watch.expected[0] if k * 0.02 <= pause else 0.0, 0.0, says_something=True)
            if watch.is_missing:
                break
        now = at
    assert found == reports


def test_an_aircraft_that_leans_for_long_is_no_more_sure_to_be_unanswered():
    watch, begin = unanswered()
    for k in range(1, 51):
        now = begin + 0.02 * k
        watch.sent(0.0, 0.0, now)
        watch.attitude_received(now, 0.2, 0.2, says_something=True)
    assert watch.evidence == 4.0


@pytest.mark.parametrize(("pause", "begins_anew"), [(0.29, False), (0.3, False), (0.32, True)])
def test_after_a_pause_of_the_sticks_everything_begins_anew(pause, begins_anew):
    watch = AnswerWatch(MODEL)
    watch.sent(20.0, 0.0, 0.0)
    watch.attitude_received(0.2, 0.0, 0.0, says_something=True)
    assert watch.expected[0] > 0.01
    watch.sent(20.0, 0.0, pause)
    assert bool(watch.expected[0] == 0.0) is begins_anew


def test_a_flight_that_begins_anew_forgets_that_nothing_answered():
    watch, begin = unanswered()
    watch.sent(0.0, 0.0, begin + 0.4)
    assert not watch.is_missing
    assert watch.evidence == 0.0


FIFTEEN = tuple(0.02 * k for k in range(16))


@pytest.mark.parametrize(
    ("sticks", "reports", "counts"),
    [
        # After the last stick a report counts for 0.3 s.
        (FIFTEEN, (0.4, 0.5, 0.6), True),
        (FIFTEEN, (0.4, 0.5, 0.62), False),
        # Reports that are farther apart than 150 ms say nothing.
        ((0.0, 0.25), (0.15, 0.29), True),
        ((0.0, 0.25), (0.15, 0.3), True),
        ((0.0, 0.25), (0.15, 0.31), False),
        # Neither does an older one, nor one while nothing may be said.
        (FIFTEEN, (0.1, 0.2, 0.15), False),
        (FIFTEEN, (0.1, 0.2, None), False),
    ],
)
def test_the_last_report_counts_or_does_not(sticks, reports, counts):
    watch, now = AnswerWatch(MODEL), 0.0
    for at in sticks:
        watch.sent(30.0, 0.0, at)
    for at in reports:
        before, now = watch.evidence, at or now + 0.05
        watch.attitude_received(now, 0.0, 0.0, says_something=at is not None)
    assert (watch.evidence != before) is counts


def test_a_gate_that_was_shut_counts_for_two_seconds_and_says_why():
    watch = AnswerWatch(MODEL)
    assert not watch.is_gate_shut(0.0)
    assert watch.missing_words(0.0) == ""
    watch.gate_reported(1.0, is_open=False)
    assert watch.is_gate_shut(3.0)
    assert watch.missing_words(3.0) == "the board reports the gate shut"
    assert not watch.is_gate_shut(3.01)
    assert watch.missing_words(3.01) == ""
    watch.gate_reported(4.0, is_open=True)
    assert not watch.is_gate_shut(4.0)


def test_only_a_gate_that_is_opened_lets_begin_anew():
    watch, _ = unanswered()
    watch.gate_reported(1.0, is_open=True)
    assert watch.is_missing
    assert watch.missing_words(1.0) == "its tilt does not follow them"
    watch.gate_reported(1.1, is_open=False)
    assert watch.is_missing
    watch.gate_reported(1.2, is_open=False)
    assert watch.is_missing
    watch.gate_reported(1.3, is_open=True)
    assert not watch.is_missing
    assert watch.missing_words(1.3) == ""


def test_a_silence_of_the_boards_leaves_nothing_to_catch_up():
    """After ten minutes without an attitude, the first one used to compute all of them at once."""
    silent, told = AnswerWatch(MODEL), AnswerWatch(MODEL)
    for k in range(3000):
        now = 0.02 * k
        for watch in (silent, told):
            watch.sent(30.0 * math.sin(now), 10.0, now)
        told.attitude_received(now, 0.0, 0.0, says_something=False)
    assert now - silent._time < REACH + 2 * STEP
    assert max(map(len, silent._commands)) < 30
    silent.attitude_received(now, 0.0, 0.0, says_something=False)
    assert silent.expected == pytest.approx(told.expected, abs=1e-12), "nothing of it is lost"

"""What of a source of poses the motion of the boards contradicts: on motion that is written down, not flown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mkdaemon.frames import rotation_from_euler
from mkdaemon.positions.motionjudge import GRAVITY, Contradiction, MotionJudge
from mkdaemon.telemetry.vision import PoseRefusal

STEP = 0.01
"""Between two poses [s]."""


def swaying(t, share=1.0, pace=4.0):
    """Place (2,) and tilt (2,) of an aircraft that sways: it leans into its acceleration."""
    a = share * np.array([0.12, 0.10])
    place = a * np.array([math.sin(pace * t), math.sin(1.3 * pace * t + 0.5)])
    acceleration = -(np.array([1.0, 1.69]) * pace**2) * place
    return place, acceleration / GRAVITY


def fly(seconds=4.0, shown=lambda place, rotation, t: (place, rotation), *, is_flown=True, start=0.0, judge=None):
    """Let a judge see a swaying aircraft, as `shown` distorts it; return it and every refusal with its time."""
    judge, refusals = judge or MotionJudge(), []
    for k in range(round(seconds / STEP)):
        t = start + k * STEP
        (x, y), (ax, ay) = swaying(t)
        place, rotation = np.array([x, y, 1.5]), rotation_from_euler(-ay, ax, 0.0)
        if k % 2 == 0:
            judge.attitude_received(t + 0.03, ax, -ay)
        seen = shown(place, rotation, t)
        if seen is not None:
            refusals.append((t, judge.take(t, *seen, is_flown=is_flown)))
    return judge, refusals


def why(refusals):
    return {refusal for _, refusal in refusals if refusal is not None}


def test_the_poses_of_the_aircraft_itself_are_taken():
    judge, refusals = fly()
    assert judge.contradiction is None
    assert why(refusals) == set()


FLIP = np.diag([1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("shown", "contradiction"),
    [
        (lambda p, r, t: (FLIP @ p, FLIP @ r @ FLIP), Contradiction.TILT),
        (lambda p, r, t: (FLIP @ p, r), Contradiction.MOTION),
        (lambda p, r, t: (p[[1, 0, 2]], r), Contradiction.MOTION),
        (lambda p, r, t: (p, rotation_from_euler(0.0, 0.0, 0.3)), Contradiction.TILT),
        (lambda p, r, t: (p, r @ rotation_from_euler(0.0, 0.0, math.pi)), Contradiction.TILT),
        (lambda p, r, t: (p, rotation_from_euler(0.2, 0.0, 0.0) @ r), Contradiction.LEANT),
        (lambda p, r, t: (p[[0, 2, 1]], rotation_from_euler(math.pi / 2, 0.0, 0.0) @ r), Contradiction.LEANT),
    ],
    ids=["mirrored", "mirrored place", "swapped axes", "another body", "turned body", "crooked", "another up"],
)
def test_a_source_that_shows_another_motion_is_contradicted_and_refused(shown, contradiction):
    judge, refusals = fly(shown=shown)
    assert judge.contradiction is contradiction
    first = next(t for t, refusal in refusals if refusal is PoseRefusal.MOTION)
    assert first < 2.5
    assert {refusal for t, refusal in refusals if t > first} == {PoseRefusal.MOTION}


def late_by(delay):
    """The pose of a moment ago under the stamp of now."""

    def shown(place, rotation, t):
        (x, y), (ax, ay) = swaying(t - delay)
        return np.array([x, y, 1.5]), rotation_from_euler(-ay, ax, 0.0)

    return shown


def test_a_delay_that_the_stamps_hide_is_contradicted():
    assert fly(shown=late_by(0.5))[0].contradiction is Contradiction.TILT
    assert fly(shown=late_by(0.03))[0].contradiction is None


def test_by_hand_only_the_tilt_is_compared():
    judge, _ = fly(shown=lambda p, r, t: (FLIP @ p, r), is_flown=False)
    assert judge.contradiction is None
    judge, _ = fly(shown=lambda p, r, t: (FLIP @ p, FLIP @ r @ FLIP), is_flown=False)
    assert judge.contradiction is Contradiction.TILT


def test_tilting_by_hand_refutes_a_contradiction_of_the_tilt():
    judge, _ = fly(shown=lambda p, r, t: (p, FLIP @ r @ FLIP))
    assert judge.contradiction is Contradiction.TILT
    judge, refusals = fly(start=4.0, judge=judge, is_flown=False)
    assert judge.contradiction is None
    assert refusals[-1][1] is None


def test_a_source_that_rests_refutes_nothing():
    judge, _ = fly(shown=lambda p, r, t: (p, FLIP @ r @ FLIP))
    for k in range(400):
        t = 4.0 + k * STEP
        judge.attitude_received(t, 0.0, 0.0)
        refusal = judge.take(t, np.array([0.0, 0.0, 0.1 + 1e-6 * k]), np.eye(3), is_flown=False)
    assert judge.contradiction is Contradiction.TILT
    assert refusal in (PoseRefusal.MOTION, PoseRefusal.OFF_COURSE)


def test_a_mirrored_place_stays_contradicted_whatever_the_source_shows_later():
    judge, _ = fly(shown=lambda p, r, t: (FLIP @ p, r))
    assert judge.contradiction is Contradiction.MOTION
    fly(start=4.0, judge=judge, shown=lambda p, r, t: (FLIP @ p, rotation_from_euler(0.2, 0.0, 0.0) @ r))
    fly(start=8.0, judge=judge, shown=lambda p, r, t: (FLIP @ p, r), is_flown=False)
    assert judge.contradiction is Contradiction.MOTION


def test_a_sender_that_starts_again_is_judged_anew():
    judge, _ = fly(shown=lambda p, r, t: (FLIP @ p, r))
    assert judge.contradiction is Contradiction.MOTION
    judge, refusals = fly(start=4.0, judge=judge.restarted())
    assert judge.contradiction is None
    assert why(refusals) == set()


def jumps(by, start=2.0, end=math.inf):
    return lambda p, r, t: (p + (np.array(by) if start <= t < end else 0.0), r)


def test_what_jumps_is_refused_until_it_is_back_or_for_five_seconds():
    _, refusals = fly(seconds=3.0, shown=jumps((0.3, 0.0, 0.0), end=2.3))
    assert [refusal for t, refusal in refusals if 2.0 <= t < 2.3] == [PoseRefusal.OFF_COURSE] * 30
    assert {refusal for t, refusal in refusals if t > 2.31} == {None}
    _, refusals = fly(seconds=8.0, shown=jumps((0.0, 2.0, 0.0)))
    back = next(t for t, refusal in refusals if t > 2.0 and refusal is None)
    assert back == pytest.approx(7.0, abs=0.05)


def test_after_a_silence_it_may_be_farther_away_but_not_anywhere():
    _, refusals = fly(
        seconds=3.0, shown=lambda p, r, t: None if 1.0 < t < 1.5 else jumps((0.4, 0.0, 0.0), 1.5)(p, r, t)
    )
    assert why(refusals) == set()
    _, refusals = fly(
        seconds=3.0, shown=lambda p, r, t: None if 1.0 < t < 1.5 else jumps((2.0, 0.0, 0.0), 1.5)(p, r, t)
    )
    assert refusals[-1][1] is PoseRefusal.OFF_COURSE


def test_the_same_numbers_again_are_no_measurement():
    judge = MotionJudge()
    place, rotation = np.array([0.1, 0.2, 0.3]), np.eye(3)
    assert judge.take(1.0, place, rotation, is_flown=False) is None
    assert judge.take(1.01, place, rotation, is_flown=False) is PoseRefusal.REPEATED
    assert judge.take(1.02, place + 1e-9, rotation, is_flown=False) is None


def test_attitudes_that_are_no_numbers_are_left_out():
    judge, _ = fly(seconds=1.0)
    judge.attitude_received(1.0, math.nan, 0.0)
    judge, _ = fly(start=1.0, judge=judge)
    assert judge.contradiction is None


def test_what_jumped_is_refused_also_where_it_passes_the_place_of_the_ones_before():
    def drifting(place, rotation, t):
        off = np.array([0.3, 0.0, 0.0]) if t >= 2.0 else np.zeros(3)
        return place + off - np.array([0.25, 0.0, 0.0]) * max(t - 2.0, 0.0), rotation

    _, refusals = fly(seconds=6.0, shown=drifting)
    assert {refusal for t, refusal in refusals if t > 2.0} == {PoseRefusal.OFF_COURSE}


def test_one_pose_aside_costs_no_other():
    _, refusals = fly(seconds=3.0, shown=jumps((0.066, 0.0, 0.0), start=1.995, end=2.005))
    assert [t for t, refusal in refusals if refusal is not None] == [pytest.approx(2.0)]

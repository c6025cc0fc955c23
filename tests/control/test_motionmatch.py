"""Do camera and boards tell of the same motion at the same time?"""

from __future__ import annotations

import math

import pytest

from mkdaemon.control.motionmatch import WINDOW, MotionMatch


def match(lag=0.0, sign=1.0, size=0.05, rate=30.0, seconds=9.0, end=None):
    """A hand that tilts the aircraft about both axes, as boards and camera tell of it."""
    motion = MotionMatch()

    def tilt(t):
        return size * math.sin(7.0 * t) + 0.6 * size * math.sin(11.0 * t), size * math.cos(9.0 * t)

    for k in range(int(seconds * 50)):
        motion.attitude_received(k / 50, *tilt(k / 50))
    for k in range(int(seconds * rate)):
        pitch, roll = tilt(k / rate)
        place = (sign * math.tan(pitch), -sign * math.tan(roll), -1.0)
        motion.target_seen("pad", k / rate + lag, place)
    return motion.match(seconds if end is None else end, "pad")


@pytest.mark.parametrize("lag", [-0.08, -0.02, 0.0, 0.033, 0.0365, 0.12])
def test_the_error_of_the_stamps_is_measured_between_the_points_of_its_grid(lag):
    found = match(lag)
    assert found.lag == pytest.approx(lag, abs=0.0015)
    assert found.likeness > 0.97


def test_a_camera_mounted_the_wrong_way_round_sees_the_opposite():
    assert match(sign=-1.0).likeness < -0.97


@pytest.mark.parametrize("silent", [{"size": 0.001}, {"rate": 4.0}, {"rate": 10.0}, {"seconds": 3.0}, {"end": 100.0}])
def test_too_little_motion_too_few_images_or_old_ones_tell_nothing(silent):
    assert match(**silent) is None


def test_images_of_another_time_tell_nothing():
    assert match(lag=7.0, end=10.0) is None


def test_a_target_above_the_camera_is_none():
    motion = MotionMatch()
    for k in range(500):
        motion.attitude_received(k / 50, 0.1 * math.sin(k), 0.0)
        motion.target_seen("pad", k / 50, (0.0, 0.0, 1.0))
    assert motion.match(10.0, "pad") is None


def beside(sign, *, other_every=1):
    """A flown target that is seen one way, and another one in view, half a metre beside it."""
    motion = MotionMatch()
    for k in range(450):
        t = k / 50
        pitch, roll = 0.05 * math.sin(7.0 * t) + 0.03 * math.sin(11.0 * t), 0.05 * math.cos(9.0 * t)
        motion.attitude_received(t, pitch, roll)
        x, y = sign * math.tan(pitch), -sign * math.tan(roll)
        motion.target_seen("pad", t, (x, y, -1.0), "down")
        if k % other_every == 0:
            motion.target_seen("other", t + 0.004, (x + 0.5, y - 0.3, -1.0), "down")
    return motion


@pytest.mark.parametrize("other_every", [1, 2])
def test_a_turned_camera_is_found_although_another_target_is_in_view(other_every):
    found = beside(-1.0, other_every=other_every).match(9.0, "pad")
    assert found.likeness < -0.97


def test_a_camera_that_sees_right_is_right_although_another_target_is_in_view():
    found = beside(1.0).match(9.0, "pad")
    assert found.likeness > 0.97
    assert found.lag == pytest.approx(0.0, abs=0.003)


def test_who_asks_for_one_target_hears_nothing_of_another():
    motion = beside(-1.0)
    assert motion.match(9.0, "third") is None
    assert motion.match(9.0, "other").likeness < -0.9


def test_of_several_cameras_that_see_one_target_the_worst_counts():
    motion = beside(1.0)
    for k in range(450):
        t = k / 50
        pitch, roll = 0.05 * math.sin(7.0 * t) + 0.03 * math.sin(11.0 * t), 0.05 * math.cos(9.0 * t)
        motion.target_seen("pad", t + 0.06, (math.tan(pitch), -math.tan(roll), -1.0), "late")
    assert motion.match(9.0, "pad").lag == pytest.approx(0.06, abs=0.003)


def test_targets_that_are_seen_no_more_are_forgotten():
    motion = MotionMatch()
    for k in range(50):
        motion.target_seen(f"target {k}", WINDOW * k, (0.1, 0.0, -1.0))
    assert len(motion._seen) == 2, "the one that is seen, and the one of a window before"


def test_a_camera_that_sees_the_opposite_is_worse_than_one_that_is_late():
    motion = beside(-1.0)
    for k in range(450):
        t = k / 50
        pitch, roll = 0.05 * math.sin(7.0 * t) + 0.03 * math.sin(11.0 * t), 0.05 * math.cos(9.0 * t)
        motion.target_seen("pad", t + 0.06, (math.tan(pitch), -math.tan(roll), -1.0), "late")
    assert motion.match(9.0, "pad").likeness < -0.97

"""Do camera and boards tell of the same motion at the same time?"""

from __future__ import annotations

import math

import numpy as np
import pytest

from mkdaemon.control.motionmatch import WINDOW, MotionMatch, _vertex


def tilts(t, size=0.05):
    """Pitch and roll of a hand that tilts the aircraft about both axes [rad]."""
    return size * math.sin(7.0 * t) + 0.6 * size * math.sin(11.0 * t), size * math.cos(9.0 * t)


def match(lag=0.0, sign=1.0, rate=30.0, seconds=9.0, end=None):
    """What is found of such a hand, as boards and camera tell of it."""
    motion = MotionMatch()
    for k in range(int(seconds * 50)):
        motion.attitude_received(k / 50, *tilts(k / 50))
    for k in range(int(seconds * rate)):
        pitch, roll = tilts(k / rate)
        place = (sign * math.tan(pitch), -sign * math.tan(roll), -1.0)
        motion.target_seen("pad", k / rate + lag, place)
    return motion.match(seconds if end is None else end, "pad")


@pytest.mark.parametrize("silent", [{"end": 100.0}, {"lag": 7.0, "end": 10.0}])
def test_old_images_and_those_of_another_time_tell_nothing(silent):
    assert match(**silent) is None


@pytest.mark.parametrize("lag", [-0.08, -0.02, 0.0, 0.033, 0.0365, 0.12])
def test_the_error_of_the_stamps_is_measured_between_the_points_of_its_grid(lag):
    found = match(lag)
    assert found.lag == pytest.approx(lag, abs=0.0015)
    assert found.likeness > 0.97


def test_a_camera_mounted_the_wrong_way_round_sees_the_opposite():
    assert match(sign=-1.0).likeness < -0.97


@pytest.fixture
def motion():
    return MotionMatch()


def beside(sign, *, other_every=1, is_late=False):
    """A flown target that is seen one way, and another one in view, half a metre beside it; perhaps a late camera."""
    motion = MotionMatch()
    for k in range(450):
        t = k / 50
        pitch, roll = tilts(t)
        motion.attitude_received(t, pitch, roll)
        x, y = sign * math.tan(pitch), -sign * math.tan(roll)
        motion.target_seen("pad", t, (x, y, -1.0), "down")
        if k % other_every == 0:
            motion.target_seen("other", t + 0.004, (x + 0.5, y - 0.3, -1.0), "down")
        if is_late:
            motion.target_seen("pad", t + 0.06, (math.tan(pitch), -math.tan(roll), -1.0), "late")
    return motion


@pytest.mark.parametrize(
    ("sign", "options", "lag"),
    [
        (-1.0, {}, None),
        (-1.0, {"other_every": 2}, None),
        (1.0, {}, 0.0),
        (1.0, {"is_late": True}, 0.06),  # of several cameras the worst counts
        (-1.0, {"is_late": True}, None),  # and the opposite is worse than late
    ],
)
def test_a_turned_or_late_camera_is_found_although_another_target_is_in_view(sign, options, lag):
    motion = beside(sign, **options)
    found = motion.match(9.0, "pad")
    assert sign * found.likeness > 0.97
    assert lag is None or found.lag == pytest.approx(lag, abs=0.003)
    assert motion.match(9.0, "third") is None
    assert sign * motion.match(9.0, "other").likeness > 0.9


def test_targets_that_are_seen_no_more_are_forgotten(motion):
    for k in range(50):
        motion.target_seen(f"target {k}", WINDOW * k, (0.1, 0.0, -1.0))
    assert len(motion._seen) == 2, "the one that is seen, and the one of a window before"


def swinging(size=0.05, *, seconds=9.0, rate=30.0, reports=50.0, lag=0.0, gap=(0.0, 0.0)):
    """A pitch that swings at 7 rad/s, with no images in a gap [s]."""
    motion = MotionMatch()
    for k in range(round(seconds * reports)):
        motion.attitude_received(k / reports, size * math.sin(7.0 * k / reports), 0.0)
    for k in range(round(seconds * rate)):
        if not gap[0] < k / rate < gap[1]:
            motion.target_seen("pad", k / rate + lag, (math.tan(size * math.sin(7.0 * k / rate)), 0.0, -1.0))
    return motion.match(seconds, "pad")


LEFT = (1.0 - math.sin(2.1) / 2.1) / math.sqrt(2.0)
"""Of what swings at 7 rad/s a mean over 0.6 s leaves sin(2.1) / 2.1, which is taken away."""


@pytest.mark.parametrize(
    ("options", "tells"),
    [
        # Four tenths of a degree in the mean.
        ({"size": math.radians(0.38) / LEFT}, False),
        ({"size": math.radians(0.42) / LEFT}, True),
        # Twelve images and reports a second.
        *(({name: 11.9}, False) for name in ("rate", "reports")),
        *(({name: 12.1}, True) for name in ("rate", "reports")),
        # Half of the window.
        ({"seconds": 3.9}, False),
        ({"seconds": 4.2}, True),
        # Half of the images.
        ({"rate": 14.0, "gap": (1.5, 7.6)}, False),
        ({"rate": 14.0, "gap": (2.0, 5.9)}, True),
    ],
)
def test_so_much_motion_so_many_images_and_so_long_a_time_tell(options, tells):
    assert (swinging(**options) is not None) is tells


def test_what_is_older_than_the_window_is_not_compared(motion):
    for k in range(1000):
        t = k / 50
        motion.attitude_received(t, 0.05 * math.sin(7.0 * t), 0.0)
        motion.target_seen("pad", t, ((1.0 if t > 11.9 else -1.0) * math.tan(0.05 * math.sin(7.0 * t)), 0.0, -1.0))
    assert motion.match(19.98, "pad").likeness > 0.99
    assert motion.match(18.0, "pad").likeness < 0.9


@pytest.mark.parametrize("lag", [-0.24, 0.24])
def test_a_quarter_of_a_second_is_the_farthest_shift(lag):
    assert match(lag).lag == pytest.approx(lag, abs=0.005)
    assert abs(match(1.25 * lag).lag) <= 0.25 + 1e-9


@pytest.mark.parametrize(("likeness", "is_opposite"), [(-0.8, True), (-0.6, False)])
def test_seven_tenths_alike_the_wrong_way_round_is_a_camera_that_is_mounted_so(motion, likeness, is_opposite):
    """One camera sees the opposite, and motion of its own; another is late."""
    # What is left of each swing when its mean over 0.6 s is taken away.
    left = {w: 1.0 - math.sin(0.3 * w) / (0.3 * w) for w in (7.0, 12.0)}
    own = math.sqrt(1.0 - likeness**2) * left[7.0] / left[12.0]
    for k in range(450):
        t = k / 50
        first, second = 0.05 * math.sin(7.0 * t), 0.05 * math.sin(12.0 * t)
        motion.attitude_received(t, first, 0.0)
        motion.target_seen("pad", t, (math.tan(likeness * first + own * second), 0.0, -1.0), "turned")
        motion.target_seen("pad", t + 0.1, (math.tan(first), 0.0, -1.0), "late")
    found = motion.match(9.0, "pad")
    assert found.likeness == pytest.approx(likeness if is_opposite else 1.0, abs=0.05)


def test_samples_that_overtake_each_other_are_compared_in_the_order_of_their_times(motion):
    for k in range(450):
        t = (k ^ 1) / 50
        motion.attitude_received(t, 0.05 * math.sin(7.0 * t), 0.05 * math.cos(9.0 * t))
        motion.target_seen("pad", t, (math.tan(0.05 * math.sin(7.0 * t)), -math.tan(0.05 * math.cos(9.0 * t)), -1.0))
    found = motion.match(9.0, "pad")
    assert found.likeness > 0.999
    assert found.lag == pytest.approx(0.0, abs=1e-4)


def test_a_target_twice_as_far_away_shows_the_same_tilt(motion):
    for k in range(450):
        t = k / 50
        pitch, roll = 0.3 * math.sin(7.0 * t), 0.2 * math.cos(9.0 * t)
        motion.attitude_received(t, pitch, roll)
        depth = 2.0 + math.sin(t)
        motion.target_seen("pad", t, (depth * math.tan(pitch), -depth * math.tan(roll), -depth))
    assert motion.match(9.0, "pad").likeness > 0.9999


def test_a_target_level_with_the_camera_is_none(motion):
    motion.target_seen("pad", 0.0, (1.0, 0.0, 0.0))
    motion.target_seen("pad", 0.0, (1.0, 0.0, 0.1))
    assert motion.match(0.0, "pad") is None
    assert not motion._seen


@pytest.mark.parametrize(
    ("values", "best", "vertex"),
    [
        ((0.0, 1.0, 0.0), 1, 0.0),
        ((0.5, 1.0, 0.9), 1, 1.0 / 3.0),  # a parabola through them: y = 1 + 0.2 x - 0.3 x^2
        ((0.9, 1.0, 0.5), 1, -1.0 / 3.0),
        ((0.0, 1.0, 1.0), 1, 0.5),
        ((1.0, 1.0, 1.0), 1, 0.0),
        ((1.0, 0.5, 0.2), 0, 0.0),
        ((0.2, 0.5, 1.0), 2, 0.0),
    ],
)
def test_a_maximum_lies_where_the_parabola_through_its_neighbours_has_it(values, best, vertex):
    assert _vertex(np.array(values), best) == pytest.approx(vertex)


def test_a_camera_that_sees_nothing_move_is_like_nothing(motion):
    for k in range(450):
        motion.attitude_received(k / 50, 0.05 * math.sin(0.14 * k), 0.0)
        motion.target_seen("pad", k / 50, (0.0, 0.0, -1.0))
    assert motion.match(9.0, "pad").likeness == 0.0


def test_no_source_fills_the_memory(motion):
    for k in range(1500):
        motion.attitude_received(0.001 * k, 0.0, 0.0)
        motion.target_seen("pad", 0.001 * k, (0.0, 0.0, -1.0))
    assert [len(motion._reported), *map(len, motion._seen.values())] == [1000, 1000]


def test_the_tilt_of_a_source_of_poses_is_compared_as_it_is(motion):
    for k in range(450):
        t = k / 50
        pitch, roll = 0.06 * math.sin(7.0 * t), 0.05 * math.cos(9.0 * t)
        motion.attitude_received(t, pitch, roll)
        motion.tilt_seen("room", t + 0.03, pitch, roll, "mocap")
    found = motion.match(9.0, "room")
    assert found.lag == pytest.approx(0.03, abs=0.0015)
    assert found.likeness > 0.97

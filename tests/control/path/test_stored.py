"""Paths that are kept: what an aircraft cannot fly is refused by its piece, its time, the limit and the remedy."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import GRAVITY, AircraftModel
from mkdaemon.control.path.curve import PathCurve
from mkdaemon.control.path.stored import KEPT, TILTED, StoredPaths
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.path import PathPiece, PathPoint, PathUploadRequest

CFG, MODEL = AutopilotConfig(), AircraftModel()
HOVER = ((0.0, 0.0, 2.0), None)


def path(*points):
    """A path by places and times."""
    return PathUploadRequest(points=tuple(PathPoint(position=place, time=time) for place, time in points))


def straight(far, time, height=2.0, up=0.0):
    """From rest to rest."""
    return path(((0.0, 0.0, height), None), ((far, 0.0, height + up), time))


def refused(request, cfg=CFG):
    with pytest.raises(CommandRejectedError) as caught:
        StoredPaths(cfg).upload(request, MODEL)
    assert caught.value.token == "path_refused"
    return caught.value


def test_what_a_path_asks_for_is_answered():
    stored = StoredPaths(CFG)
    answer = stored.upload(straight(2.0, 4.0), MODEL)
    # Least jerk: 1.875 times the mean speed, and 5.77 times the way by the square of the time.
    assert (answer.duration, answer.length, answer.pieces) == (4.0, pytest.approx(2.0), 1)
    assert answer.speed == pytest.approx(1.875 * 0.5)
    assert answer.acceleration == pytest.approx(5.77 * 2.0 / 16.0, rel=0.02)
    assert answer.climb == 0.0
    assert stored.find(answer.id).answer == answer
    assert stored.find(answer.id).drawn[0] == (0.0, 0.0, 2.0)
    assert stored.find(answer.id).drawn[-1] == (2.0, 0.0, 2.0)


def test_the_same_path_has_the_same_id_and_another_one_another():
    one, other = StoredPaths(CFG), StoredPaths(CFG)
    assert one.upload(straight(2.0, 4.0), MODEL) == other.upload(straight(2.0, 4.0), MODEL)
    assert one.upload(straight(2.0, 4.1), MODEL).id != one.upload(straight(2.0, 4.0), MODEL).id
    assert len(one.ids) == 2


@pytest.mark.parametrize(
    ("request_", "words", "limit"),
    [
        (straight(3.0, 4.0), "m/s; control.autopilot.max_speed is 1.20", "1.17"),
        (straight(0.5, 1.4), "m/s2; control.autopilot.max_acceleration is 1.40", "1.05"),
        (straight(0.0, 3.0, up=1.2), "m/s up or down; control.autopilot.max_climb is 0.60", "1.25"),
        (straight(0.0, 0.9, up=0.2), "m/s2 up or down; the limit of every flight is 0.80", "1.34"),
    ],
)
def test_a_path_that_is_too_fast_says_by_how_much_and_slowed_down_it_is_taken(request_, words, limit):
    error = refused(request_)
    assert words in error.reason
    assert "piece 1 of 1, at " in error.reason
    factor = float(re.search(r"by ([0-9.]+):", error.fix)[1])
    assert factor == pytest.approx(float(limit), abs=0.011)
    first, second = request_.points
    slower = path((first.position, None), (second.position, second.time * factor))
    assert StoredPaths(CFG).upload(slower, MODEL).duration == pytest.approx(second.time * factor)


def test_a_path_that_leans_too_far_is_refused_by_the_tilt():
    cfg = AutopilotConfig(max_tilt=0.15)
    error = refused(straight(1.0, 2.2), cfg)
    assert "rad of tilt; 75% of control.autopilot.max_tilt is 0.11" in error.reason
    assert StoredPaths(cfg).upload(straight(1.0, 3.0), MODEL)


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (straight(6.0, 20.0), "is 6.00 m from the middle, farther than 5 m, which is control.autopilot.fence_radius"),
        (straight(1.0, 9.0, height=6.5), "is 6.50 m high, above 6 m, which is control.autopilot.fence_height"),
        (straight(1.0, 9.0, height=0.2), "is 0.20 m high, below 0.3 m, which is control.autopilot.fence_floor"),
    ],
)
def test_a_path_outside_the_fence_is_refused(request_, words):
    error = refused(request_)
    assert words in error.reason
    assert error.fix.startswith("Move it inside")


def piece(duration, x, **more):
    return PathPiece(duration=duration, x=x, y=(0.0,), z=(2.0,), **more)


SPEEDS_UP = (0.0, 0.0, 0.0, 0.1, -0.025)
"""x = 0.1 t^3 - 0.025 t^4: after 2 s at 0.4 m, 0.4 m/s, without acceleration."""
SLOWS_DOWN = (0.4, 0.4, 0.0, -0.1, 0.025)
"""And from there to rest at 0.8 m."""


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        ([piece(2.0, SPEEDS_UP), piece(2.0, SLOWS_DOWN)], ""),
        ([piece(2.0, SPEEDS_UP)], "piece 1 of 1, at 2.0 s, ends at 0.4 m/s, not at rest"),
        ([piece(2.0, SLOWS_DOWN)], "piece 1 of 1, at 0.0 s, begins at 0.4 m/s, not at rest"),
        (
            [piece(2.0, SPEEDS_UP), piece(2.0, (0.5, *SLOWS_DOWN[1:]))],
            "piece 2 of 2, at 2.0 s, begins with a step of 0.1 m in its position",
        ),
        (
            [piece(2.0, SPEEDS_UP), piece(2.0, (0.4, 0.2, 0.0, 0.0, 0.0))],
            "piece 2 of 2, at 2.0 s, begins with a step of 0.2 m/s in its velocity",
        ),
        (
            [piece(2.0, SPEEDS_UP), piece(1.0, (0.4, 0.4, -0.2))],
            "piece 2 of 2, at 2.0 s, begins with a step of 0.4 m/s2 in its acceleration",
        ),
        (
            [piece(2.0, SPEEDS_UP, yaw=(0.0,)), piece(2.0, SLOWS_DOWN, yaw=(0.1,))],
            "piece 2 of 2, at 2.0 s, begins with a step of 0.1 m in its position",
        ),
        ([piece(9.0, (0.0,), yaw=(0.0, 0.2))], "asks for 0.20 rad/s of turn; the limit of every flight is 0.17"),
    ],
)
def test_pieces_that_do_not_fit_are_named(pieces, words):
    request = PathUploadRequest(pieces=tuple(pieces))
    if words:
        assert words in refused(request).reason
    else:
        assert StoredPaths(CFG).upload(request, MODEL).length == pytest.approx(0.8)


places = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(0.5, 5.0))


@given(st.lists(st.tuples(places, st.floats(0.2, 20.0)), min_size=2, max_size=6))
def test_what_is_taken_stays_within_every_limit_and_what_is_refused_is_beyond_one(points):
    request = path(*((place, time if number else None) for number, (place, time) in enumerate(points)))
    curve = PathCurve.of(request)
    motion = curve.at(np.linspace(0.0, curve.duration, 500))
    level = [np.hypot(*each[:, :2].T).max() for each in (motion.position, motion.velocity, motion.acceleration)]
    tilt = np.hypot(*(motion.acceleration + MODEL.drag * motion.velocity)[:, :2].T).max() / GRAVITY
    use = max(
        level[0] / CFG.fence_radius,
        level[1] / CFG.max_speed,
        level[2] / CFG.max_acceleration,
        tilt / (TILTED * CFG.max_tilt),
        np.abs(motion.velocity[:, 2]).max() / CFG.max_climb,
        np.abs(motion.acceleration[:, 2]).max() / 0.8,
        motion.position[:, 2].max() / CFG.fence_height,
        CFG.fence_floor / max(motion.position[:, 2].min(), 1e-9),
    )
    try:
        StoredPaths(CFG).upload(request, MODEL)
    except CommandRejectedError as error:
        assert use > 0.97
        found = re.search(r"piece (\d+) of (\d+), at ([0-9.]+) s,", error.reason)
        number, of, when = int(found[1]), int(found[2]), float(found[3])
        assert of == len(points) - 1
        assert curve.starts[number - 1] - 0.06 <= when <= curve.starts[number - 1] + curve.durations[number - 1] + 0.06
    else:
        assert use < 1.03  # between the places of a piece that are looked at


def test_the_newest_are_kept_and_the_one_in_use():
    stored = StoredPaths(CFG)
    first = stored.upload(straight(1.0, 4.0), MODEL).id
    stored.use("none of them")
    stored.use(first)
    others = [stored.upload(straight(1.0, 4.0 + 0.1 * number), MODEL).id for number in range(1, KEPT + 4)]
    assert len(stored.ids) == KEPT
    assert stored.ids == {first, *others[-(KEPT - 1) :]}
    stored.use(others[-1])
    stored.upload(straight(1.0, 9.0), MODEL)
    assert first not in stored.ids


def test_an_upload_again_makes_a_path_the_newest():
    stored = StoredPaths(CFG)
    first = stored.upload(straight(1.0, 4.0), MODEL).id
    for number in range(1, KEPT):
        stored.upload(straight(1.0, 4.0 + 0.1 * number), MODEL)
    assert stored.upload(straight(1.0, 4.0), MODEL).id == first
    stored.upload(straight(1.0, 9.0), MODEL)
    assert first in stored.ids


def test_the_times_of_points_count_their_stops():
    points = (
        PathPoint(position=(0.0, 0.0, 2.0), stop=1.0),
        PathPoint(position=(1.0, 0.0, 2.0), time=4.0, stop=0.0),
        PathPoint(position=(1.0, 1.0, 2.0), time=3.0, stop=2.0),
        PathPoint(position=(0.0, 1.0, 2.0), time=5.0),
    )
    answer = StoredPaths(CFG).upload(PathUploadRequest(points=points), MODEL)
    assert answer.times == (0.0, 5.0, 8.0, 15.0)
    assert answer.duration == 15.0

"""A path as a function of time: through its points, smooth, at rest at its stops; polynomials as they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mkdaemon.control.path.curve import GENTLE, PathCurve
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.path import PathPiece, PathPoint, PathUploadRequest

EPS = 1e-6

places = st.tuples(*[st.floats(-3.0, 3.0).map(lambda x: round(x, 3))] * 3)
points_of_paths = st.lists(
    st.tuples(places, st.floats(0.3, 3.0), st.sampled_from([None, None, None, 0.0, 0.7])), min_size=2, max_size=9
)


def path(*points, **more):
    """A path by (position, time) or (position, time, stop)."""
    return PathUploadRequest(
        points=tuple(
            PathPoint(position=place, time=time if number else None, stop=rest[0] if rest else None, **more)
            for number, (place, time, *rest) in enumerate(points)
        )
    )


def at(curve, time):
    """Position, velocity and acceleration at one time."""
    motion = curve.at(np.array([time]))
    return motion.position[0], motion.velocity[0], motion.acceleration[0]


@given(points_of_paths)
def test_it_is_smooth_passes_its_points_and_rests_at_its_stops(points):
    curve = PathCurve.of(path(*points))
    time = 0.0
    for number, (place, spent, stop) in enumerate(points):
        time += spent if number else 0.0
        position, velocity, _ = at(curve, time)
        assert position[:3] == pytest.approx(place, abs=1e-6)
        if stop is not None:
            assert velocity == pytest.approx(np.zeros(4), abs=1e-6)
            time += stop
            assert at(curve, time)[0][:3] == pytest.approx(place, abs=1e-6)
    assert curve.duration == pytest.approx(time)
    for begin in curve.starts[1:]:
        before, after = at(curve, begin - EPS), at(curve, begin + EPS)
        size = 1.0 + max(np.abs(part).max() for part in (*before, *after))
        for one, other in zip(before, after, strict=True):
            assert one == pytest.approx(other, abs=3e-3 * size)


@given(points_of_paths)
def test_velocity_and_acceleration_are_the_derivatives(points):
    curve = PathCurve.of(path(*points))
    times = np.linspace(0.0, curve.duration, 40)[1:-1]
    low, here, high = (curve.at(times + shift) for shift in (-EPS, 0.0, EPS))
    size = 1.0 + np.abs(here.acceleration).max()
    assert (high.position - low.position) / (2 * EPS) == pytest.approx(here.velocity, abs=1e-4 * size)
    assert (high.velocity - low.velocity) / (2 * EPS) == pytest.approx(here.acceleration, abs=3e-3 * size)


@pytest.mark.parametrize("speed", [0.2, 0.5, 1.0])
def test_a_speed_is_flown_at_and_stops_are_left_gently(speed):
    points = [PathPoint(position=(0.3 * k, 0.0, 1.0), speed=speed if k else None) for k in range(41)]
    curve = PathCurve.of(PathUploadRequest(points=tuple(points)))
    motion = curve.at(np.linspace(0.0, curve.duration, 2000))
    assert at(curve, curve.duration / 2)[1][0] == pytest.approx(speed, rel=0.01)
    # Next to a stop the curve is faster for a moment, if the first way is long for its speed.
    assert motion.velocity[:, 0].max() < 1.45 * speed
    assert np.abs(motion.acceleration[:, 0]).max() < 2.0 * GENTLE
    assert curve.duration == pytest.approx(12.0 / speed + speed / GENTLE, rel=0.01)


def test_a_heading_turns_the_shorter_way():
    points = [((0.0, 0.0, 1.0), 0.0), ((1.0, 0.0, 1.0), 40.0)]
    yaws = (math.radians(170.0), math.radians(-170.0))
    request = PathUploadRequest(
        points=tuple(
            PathPoint(position=place, time=time or None, yaw=yaw)
            for (place, time), yaw in zip(points, yaws, strict=True)
        )
    )
    curve = PathCurve.of(request)
    assert curve.turns
    assert at(curve, 20.0)[0][3] == pytest.approx(math.pi)


def test_polynomials_are_flown_as_they_are():
    pieces = (
        PathPiece(duration=2.0, x=(0.0, 0.0, 1.0), y=(1.0,), z=(2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)),
        PathPiece(duration=1.0, x=(4.0, 4.0), y=(1.0,), z=(2.0,)),
    )
    curve = PathCurve.of(PathUploadRequest(pieces=pieces))
    assert not curve.turns
    position, velocity, acceleration = at(curve, 1.5)
    assert position == pytest.approx((2.25, 1.0, 2.0 + 0.5 * 1.5**7, 0.0))
    assert velocity == pytest.approx((3.0, 0.0, 3.5 * 1.5**6, 0.0))
    assert acceleration == pytest.approx((2.0, 0.0, 21.0 * 1.5**5, 0.0))
    assert at(curve, 2.5)[0][0] == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([{"time": None}, {"speed": 0.5}, {"speed": 0.5}], "point 2 is where the one before is"),
        ([{"yaw": 0.1}, {"time": 1.0}], "point 2 has no yaw"),
        ([{}, {"time": 1.0, "yaw": 0.1}], "point 1 has no yaw"),
    ],
)
def test_points_that_make_no_path_are_named(points, words):
    request = PathUploadRequest(points=tuple(PathPoint(position=(0.0, 0.0, 2.0), **more) for more in points))
    with pytest.raises(CommandRejectedError, match=words) as refused:
        PathCurve.of(request)
    assert refused.value.token == "path_refused"
    assert refused.value.fix.startswith("Give")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "points or pieces"),
        ({"points": ({"position": (0, 0, 1)},)}, "at least two points"),
        ({"points": ({"position": (0, 0, 1)}, {"position": (1, 0, 1)})}, "point 2: give time or speed"),
        ({"points": ({"position": (0, 0, 1)}, {"position": (1, 0, 1), "time": 1, "speed": 1})}, "point 2"),
        ({"points": ({"position": (0, 0, math.nan)}, {"position": (1, 0, 1), "time": 1})}, "finite"),
        ({"points": ({"position": (0, 0, 1)}, {"position": (1, 0, 1), "time": 0.0})}, "greater than"),
        ({"pieces": ({"duration": 1.0, "x": (0,) * 9, "y": (0,), "z": (0,)},)}, "at most 8"),
    ],
)
def test_what_is_no_path_is_not_read(fields, words):
    with pytest.raises(ValidationError, match=words):
        PathUploadRequest.model_validate(fields)

"""What an image says of the place of a target, and how sure it is of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mkdaemon.control.estimator.values import StickCommand, TargetView, ThrottleUse, ViewFault, fault_of
from mkdaemon.control.linear import Array


def turned(vector) -> Array:
    """Rotation (3, 3) by a vector [rad]."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


PLACE = np.array([0.4, -0.7, 2.1])
RANDOM = np.random.default_rng(29).normal(size=(6, 6))
COVARIANCE = 1e-4 * RANDOM @ RANDOM.T + 1e-4 * np.eye(6)


def view(rotation=(0.1, -0.2, 0.9), *, at=5.0, covariance=COVARIANCE, place=PLACE) -> TargetView:
    r = turned(rotation)
    return TargetView(at, -r.T @ place, r, covariance)


@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.9), (-0.3, 0.1, -2.5)])
def test_the_covariance_of_where_a_target_is_seen_follows_from_that_of_the_pose(rotation):
    """The derivative of -R'p by place and attitude, by differences in place of the formula."""
    seen, step = view(rotation), 1e-6
    moved = [(PLACE + step * axis, seen.target_from_flu) for axis in np.eye(3)]
    moved += [(PLACE, turned(step * axis) @ seen.target_from_flu) for axis in np.eye(3)]
    columns = [(-r.T @ place - seen.position_flu) / step for place, r in moved]
    jacobian = np.column_stack(columns)
    assert seen.sight_covariance == pytest.approx(jacobian @ COVARIANCE @ jacobian.T, rel=1e-3, abs=1e-9)


def test_a_view_tells_the_heading_of_the_vehicle():
    assert view((0.0, 0.0, 0.8)).heading == pytest.approx(0.8)


def with_diagonal(value):
    return np.diag([value] * 6)


@pytest.mark.parametrize(
    ("seen", "fault"),
    [
        (view(), None),
        (view(at=5.02), None),
        (view(at=5.02 + 1e-6), ViewFault.FUTURE),
        (view(at=4.2), None),
        (view(at=4.2 - 1e-6), ViewFault.TOO_OLD),
        (view(covariance=with_diagonal(0.0)), ViewFault.NO_COVARIANCE),
        (view(covariance=with_diagonal(1e-12)), None),
        (view(covariance=COVARIANCE + 1e-3 * np.triu(np.ones((6, 6)), 1)), ViewFault.NO_COVARIANCE),
        (view(place=np.array([2e3, 0.0, 2.0])), ViewFault.TOO_FAR),
        (view(place=np.array([0.0, 0.0, -2e3])), ViewFault.TOO_FAR),
        (view(covariance=with_diagonal(2e6)), ViewFault.TOO_FAR),
    ],
)
def test_only_what_can_be_seen_is_used(seen, fault):
    assert fault_of(seen, 5.0) is fault


@pytest.mark.parametrize(("cap", "acting"), [(None, 130.0), (120.0, 120.0), (140.0, 130.0)])
def test_the_motors_get_no_more_than_the_pilots_throttle(cap, acting):
    assert StickCommand(0.0, 0.0, 0.0, 0.0, 130.0, ThrottleUse(cap, is_ours=False)).acting_gas == acting


@pytest.mark.parametrize(("skew", "is_sound"), [(0.9e-3, True), (1.1e-3, False)])
def test_an_attitude_and_a_covariance_may_be_off_by_a_thousandth(skew, is_sound):
    stretched = np.diag([math.sqrt(1.0 + skew), 1.0, 1.0])
    seen = TargetView(5.0, np.array([0.0, 0.0, -2.0]), stretched, COVARIANCE)
    assert fault_of(seen, 5.0) is (None if is_sound else ViewFault.NO_ROTATION)
    crooked = COVARIANCE.copy()
    crooked[0, 1] += skew * np.abs(COVARIANCE).max()
    assert fault_of(view(covariance=crooked), 5.0) is (None if is_sound else ViewFault.NO_COVARIANCE)


@pytest.mark.parametrize(("far", "is_sound"), [(1000.0, True), (1000.1, False)])
def test_nothing_is_seen_from_farther_than_a_kilometre(far, is_sound):
    fault = None if is_sound else ViewFault.TOO_FAR
    rotation = np.eye(3)
    assert fault_of(TargetView(5.0, np.array([0.0, far, -2.0]), rotation, COVARIANCE), 5.0) is fault
    assert fault_of(TargetView(5.0, np.array([0.0, -far, -2.0]), rotation, COVARIANCE), 5.0) is fault
    assert fault_of(view(covariance=with_diagonal(far**2)), 5.0) is fault

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


def stretched(skew):
    """A view whose attitude is stretched by a share."""
    return TargetView(5.0, np.array([0.0, 0.0, -2.0]), np.diag([math.sqrt(1.0 + skew), 1.0, 1.0]), COVARIANCE)


def crooked(skew):
    """A view whose covariance is not symmetric by a share."""
    return view(covariance=COVARIANCE + skew * np.abs(COVARIANCE).max() * np.eye(6)[:, :1] @ np.eye(6)[1:2])


def aside(far):
    """A view of a target that far to one side [m]."""
    return TargetView(5.0, np.array([0.0, far, -2.0]), np.eye(3), COVARIANCE)


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
        (stretched(0.9e-3), None),
        (stretched(1.1e-3), ViewFault.NO_ROTATION),
        (crooked(0.9e-3), None),
        (crooked(1.1e-3), ViewFault.NO_COVARIANCE),
        (view(place=np.array([0.0, 0.0, -2e3])), ViewFault.TOO_FAR),
        (aside(1000.0), None),
        (aside(1000.1), ViewFault.TOO_FAR),
        (aside(-1000.1), ViewFault.TOO_FAR),
        (view(covariance=with_diagonal(1000.0**2)), None),
        (view(covariance=with_diagonal(1000.1**2)), ViewFault.TOO_FAR),
    ],
)
def test_only_what_can_be_seen_is_used(seen, fault):
    assert fault_of(seen, 5.0) is fault


@pytest.mark.parametrize(("cap", "acting"), [(None, 130.0), (120.0, 120.0), (140.0, 130.0)])
def test_the_motors_get_no_more_than_the_pilots_throttle(cap, acting):
    assert StickCommand(0.0, 0.0, 0.0, 0.0, 130.0, ThrottleUse(cap, is_ours=False)).acting_gas == acting

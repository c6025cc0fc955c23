"""Platforms move as their kind says."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.frames import euler_from_rotation
from mksim.scene.motion import Platform


def velocity(platform: Platform, time: float) -> np.ndarray:
    return (platform.pose_at(time + 1e-4).position_enu - platform.pose_at(time - 1e-4).position_enu) / 2e-4


def test_still_stays_with_its_attitude() -> None:
    pose = Platform(start_enu=(1.0, 2.0, 0.5), heading=0.3, roll=0.1, pitch=-0.2).pose_at(9.0)
    np.testing.assert_allclose(pose.position_enu, (1.0, 2.0, 0.5))
    assert euler_from_rotation(pose.enu_from_body) == pytest.approx((0.1, -0.2, 0.3))


def test_a_straight_platform_stands_at_its_start_until_it_moves_and_keeps_its_speed() -> None:
    platform = Platform("straight", start_enu=(1.0, 0.0, 0.0), heading=np.pi / 2, speed=0.5, delay=3.0)
    for time, north in ((2.9, 0.0), (5.0, 1.0)):
        np.testing.assert_allclose(platform.pose_at(time).position_enu, (1.0, north, 0.0), atol=1e-12)
    np.testing.assert_allclose(velocity(platform, 6.0), (0.0, 0.5, 0.0), atol=1e-6)


def test_a_circle_closes_and_faces_along_its_path() -> None:
    platform = Platform("circle", start_enu=(1.0, 0.0, 0.0), heading=0.4, speed=0.5, radius=2.0)
    round_trip = 2 * np.pi * 2.0 / 0.5
    np.testing.assert_allclose(platform.pose_at(round_trip).position_enu, (1.0, 0.0, 0.0), atol=1e-9)
    for time in (1.0, 2.0, 7.0):
        pose = platform.pose_at(time)
        np.testing.assert_allclose(velocity(platform, time), 0.5 * pose.enu_from_body[:, 0], atol=1e-6)
    assert np.linalg.norm(platform.pose_at(round_trip / 2).position_enu - (1.0, 0.0, 0.0)) == pytest.approx(4.0)


def test_a_ramp_starts_at_rest_and_reaches_its_speed() -> None:
    platform = Platform("ramp", speed=1.0, acceleration=0.5)
    speeds = [float(velocity(platform, time)[0]) for time in (0.5, 1.0, 2.5, 4.0)]
    assert speeds == pytest.approx([0.25, 0.5, 1.0, 1.0], abs=1e-6)
    np.testing.assert_allclose(platform.pose_at(-1.0).position_enu, 0.0, atol=1e-12)

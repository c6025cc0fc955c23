"""Mounting, deck and attitude from normals that images show: what can be told apart, and what can not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.selfcal.selfcheck import DECK, LENS_AT, MOUNTING, SIZES_AT, TILT_SCALE, CameraFilter, ImageEvidence
from tests.vision.views import VGA, shipped

BELIEVED = LOOKING_DOWN.flu_from_cam
RIGID = replace(shipped("single"), bend=0.0)
PROJECTION = Projection(VGA)
TURN = np.radians([2.0, -2.2, 0.0])
DECK_NORMAL = np.array([np.radians(1.5), np.radians(-1.0), 1.0])


def evidence(rotation: np.ndarray, lens: np.ndarray | None = None) -> ImageEvidence:
    """An image that shows a pose exactly, and knows the lens where one is given."""
    known = np.zeros(SIZES_AT + 1)
    matrix = np.diag([*[1e6] * 6, *known])
    if lens is not None:
        known[LENS_AT:] = 1e6, 1.0, 1.0, 1e6, 0.0
        matrix = np.diag([*[1e6] * 6, *known])
        known[LENS_AT:] *= lens
    return ImageEvidence(rotation, matrix, np.array([*[0.0] * 6, *known]))


def flown(
    yaw: Callable[[float], float], *, moving: bool = False, reported: float = 1.0, seconds: float = 10.0
) -> CameraFilter:
    """Ten images a second of a tilted deck with a camera that hangs otherwise than believed."""
    found = CameraFilter(replace(RIGID, moving=moving), PROJECTION, np.radians(1.0), BELIEVED)
    rng = np.random.default_rng(4)
    true_mounting = rotation_from_euler(float(TURN[0]), float(TURN[1]), 0.0) @ BELIEVED
    normal = DECK_NORMAL / np.linalg.norm(DECK_NORMAL)
    deck = np.column_stack([np.cross([0.0, 1.0, 0.0], normal), [0.0, 1.0, 0.0], normal])
    for time in np.arange(0.0, seconds, 0.1):
        roll, pitch = 0.07 * np.sin(1.3 * time), 0.07 * np.sin(2.1 * time + 1.0)
        seen = (rotation_from_euler(roll, pitch, yaw(time)) @ true_mounting).T @ deck
        tilt = reported * np.array([roll, pitch]) + np.radians(0.3) * rng.standard_normal(2)
        found.image_seen(float(time), evidence(seen), rotation_from_euler(*tilt, yaw(time)))
    return found


def test_yaw_tells_a_turned_mounting_from_a_tilted_deck() -> None:
    found = flown(lambda time: np.radians(60.0) * np.sin(0.6 * time))
    assert np.degrees(found.mean[MOUNTING] - TURN)[:2] == pytest.approx([0.0, 0.0], abs=0.3)
    assert np.degrees(found.mean[DECK] - DECK_NORMAL[:2]) == pytest.approx([0.0, 0.0], abs=0.3)
    assert np.degrees(found.sd[MOUNTING][:2]).max() < 0.3


def test_without_yaw_a_mounting_and_a_deck_look_alike_and_the_deviation_says_so() -> None:
    found = flown(lambda _time: 0.4)
    assert np.degrees(found.sd[MOUNTING][:2]).min() > 2.0
    assert (np.abs(found.mean[MOUNTING] - TURN)[:2] < 2 * found.sd[MOUNTING][:2]).all()


def test_a_vehicle_that_reports_too_much_tilt_is_no_turned_mounting() -> None:
    found = flown(lambda time: 0.7 * time, reported=1.1)
    assert found.mean[TILT_SCALE] == pytest.approx(0.1, abs=0.06)
    assert np.degrees(found.mean[MOUNTING] - TURN)[:2] == pytest.approx([0.0, 0.0], abs=0.3)


def test_on_a_moving_deck_more_time_is_needed() -> None:
    still, moving = (flown(lambda time: 0.7 * time, moving=moves) for moves in (False, True))
    assert moving.sd[MOUNTING][0] > 1.1 * still.sd[MOUNTING][0]


def test_without_attitude_or_mounting_only_the_lens_is_learned() -> None:
    off = np.array([0.02, 3.0, -2.0, 0.01, 0.0])
    for mounting, attitude in ((None, np.eye(3)), (BELIEVED, None)):
        found = CameraFilter(RIGID, PROJECTION, np.radians(1.0), mounting)
        for k in range(20):
            found.image_seen(0.1 * k, evidence(BELIEVED.T, off), attitude)
        np.testing.assert_allclose(found.mean[LENS_AT:], off, rtol=0.01)
        assert np.degrees(found.sd[MOUNTING][0]) == pytest.approx(5.0, abs=0.1)

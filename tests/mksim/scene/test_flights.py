"""Flights are repeatable, stay in their envelope, bring every hardship, and keep the target mostly in view."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.frames import euler_from_rotation
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import single
from mksim.scene.flights import HIGHEST_M, LOWEST_M, random_flight
from mksim.scene.motion import Platform
from mksim.scene.scene import SceneTarget, true_corners

CAMERA = Intrinsics(width=640, height=480, fx=600, fy=600, cx=319.5, cy=239.5)
SIZE = 0.3048


def test_equal_seeds_give_equal_flights() -> None:
    first, again, other = (list(random_flight(seed, CAMERA, tag_size=SIZE, duration=2.0)) for seed in (3, 3, 4))
    assert len(first) == 30
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.view.enu_from_cam, b.view.enu_from_cam)
        assert a.conditions == b.conditions
    assert not np.allclose(first[5].view.position_enu, other[5].view.position_enu)


def test_flights_fill_their_envelope_and_bring_every_hardship() -> None:
    target = SceneTarget.of(single(SIZE, 48), Platform())
    heights, in_view, shake, seen = [], 0, [], set()
    for seed in range(12):
        frames = list(random_flight(seed, CAMERA, tag_size=SIZE))
        heights += [frame.view.position_enu[2] for frame in frames]
        rolls = np.array([euler_from_rotation(frame.enu_from_flu)[0] for frame in frames])
        shake.append(np.degrees(np.diff(rolls, 2)).std() / np.sqrt(6))
        for frame in frames:
            middle = true_corners(target, frame.view)["tag36h11", 48].mean(axis=0)
            in_view += bool((middle > 0).all() and (middle < (640, 480)).all())
            conditions = frame.conditions
            seen |= {name for name in ("covers", "glare", "shadow") if getattr(conditions, name)}
            seen |= {"blur"} if frame.view.exposure_time > 0.01 else set()
    assert len(heights) == 1440
    assert LOWEST_M <= min(heights) < 0.4
    assert 4.0 < max(heights) <= HIGHEST_M
    assert in_view / 1440 > 0.95
    assert np.mean(shake) == pytest.approx(0.7, rel=0.15)
    assert seen == {"covers", "glare", "shadow", "blur"}

"""The trials of `lab vision --case adverse`: what lies over a target, and one that is flown for a moment."""

from __future__ import annotations

import numpy as np
import pytest

from lab.vision import adverse
from lab.vision.flight import VGA
from lab.vision.stills import SeedSet
from mksim.scene.light import LightConditions
from mksim.scene.view import CameraView

SIDE = 0.3


@pytest.mark.parametrize("name", ["hand", "foot"])
def test_hand_and_foot_lie_over_a_side_and_move(name):
    change = adverse.TRIALS[name].change(np.random.default_rng(4), SIDE)
    middles = []
    for time in (0.0, 0.6, 1.2):
        view = CameraView(VGA, np.eye(3), np.zeros(3), time=time)
        points = np.concatenate([cover.polygon for cover in change(view, LightConditions()).covers])
        inside = np.abs(points).max(axis=1) < SIDE / 2
        assert 0.0 < inside.mean() < 0.9, "rooted outside, its tip inside"
        middles.append(points.mean(axis=0))
    assert np.ptp(middles, axis=0).max() > 0.01


def test_a_trial_is_flown_through_four_programs(monkeypatch):
    monkeypatch.setattr(adverse, "SECONDS", 0.1)
    part = next(part for part in adverse.ADVERSE.plan(True, SeedSet.DEVELOPMENT) if part.args[0] == "fog")
    row = adverse.ADVERSE.sum_up(True, [part], [adverse._fly(*part.args)])["fog"]
    assert set(row) == {"eyes_with_attitude", "eyes_without", "apriltag", "opencv"}
    assert [row["eyes_with_attitude"][name] for name in ("images", "posed", "wrong")] == [3, 3, 0]

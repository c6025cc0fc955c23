"""Flights through hardships: what lies over a target moves, and a moment of each kind is flown."""

from __future__ import annotations

import numpy as np
import pytest

from lab.vision import adverse
from lab.vision.flight import VGA
from lab.vision.flights import FLOWN, fly_row
from lab.vision.looks import WITH, WITHOUT
from lab.vision.parts import Part
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


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("hardships", "curl"),
        ("hardships", "auto_exposure"),
        ("adverse", "fog"),
        ("real", "rolling"),
        ("flights", "single"),
    ],
)
def test_a_moment_is_flown_with_attitude_and_without(kind, name):
    part = Part(fly_row, (name, kind, 3_001_401, 0.2), 6)
    row = FLOWN[kind].sum_up(True, [part], [part.run()])[name]
    assert set(row) == {WITH, WITHOUT}
    seen = row[WITH] if kind != "real" else row[WITH]["to_4_m"]
    assert (seen["images"], seen["wrong"]) == (6, 0)
    assert seen["posed"] >= 3

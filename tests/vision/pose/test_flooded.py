"""Cells and edges that a highlight floods, where the paper around them is blown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.gates import CellReader
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.gloss import Gloss
from mksim.scene.light import LightConditions
from tests.vision.views import VGA, View, place, shipped


@pytest.mark.parametrize("tilt", [0.0, 0.03, 0.06])
def test_cells_that_a_highlight_floods_contradict_no_pose_and_the_others_do(tilt: float) -> None:
    target = shipped("nested")
    view = View(target, place(1.2, 0.03, 0.7, 0.4), LightConditions(gloss=Gloss(0.06, (tilt, 0.0, 1.0)), exposure=1.2))
    pose = Pose(view.rotation, view.position, 1e-8 * np.eye(6), "edges", 40, 0.1)
    cells = CellReader(target, Projection(VGA))
    assert cells.evidence(view.pixels, pose).vouches
    for column, row in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1), (3, 0), (-1, 0), (0, -1)):
        aside = pose.position + target.tags[0].module * np.array([column, row, 0.0])
        assert not cells.evidence(view.pixels, replace(pose, position=aside)).vouches


def test_edges_that_a_highlight_floods_are_not_missed() -> None:
    target = shipped("nested")
    projection = Projection(VGA)
    view = View(target, place(1.2, 0.03, 0.7, 0.4), LightConditions(gloss=Gloss(0.06, (0.1, 0.0, 1.0)), exposure=1.2))
    start = Pose(view.rotation, view.position, 1e-8 * np.eye(6), "edges", 40, 0.1)
    found = EdgeFit(target, projection).fit(view.pixels, start)
    assert found.inliers > 0.9
    assert np.linalg.norm(found.position - view.position) < 0.005
    covered = view.pixels.copy()
    column, row = projection.project(view.position[None])[0][0].astype(int)
    covered[row:, column:] = 255
    found = EdgeFit(target, projection).fit(covered, start)
    assert found is None or found.inliers < 0.9

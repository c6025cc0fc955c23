"""Which edges of a target are asked: none that another tag's paper comes near to."""

from __future__ import annotations

import numpy as np
import pytest

from lab.vision.flight import VGA
from lab.vision.stills import target_named
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.edgemodel import EdgeModel
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import view_towards


def test_no_edge_of_the_outer_tag_has_the_paper_of_the_inner_one_within_half_a_cell() -> None:
    target = target_named("nested")
    model, (outer, inner) = EdgeModel.of(target), target.tags
    own = model.tag == 0
    beside = 0.5 * outer.module * model.normals[own]
    for points in (model.points[own] - beside, model.points[own], model.points[own] + beside):
        assert not bool((np.abs(points[:, :2]).max(axis=1) <= inner.paper / 2).any())
    single = EdgeModel.of(target_named("single"))
    assert int(own.sum()) > 0.75 * len(single.points)


@pytest.mark.parametrize("distance", [1.8, 2.5, 3.5])
def test_all_edges_of_a_plain_nested_target_agree(distance: float) -> None:
    pad = SceneTarget.of(target_named("nested"), Platform())
    view = view_towards(VGA, distance * np.array([0.2, 0.1, 0.97]), np.zeros(3))
    rotation, position = cam_from_target(pad, view)
    pixels = Scene([pad], ground=None, seed=4, fine=False).render(view, LightConditions())
    found = EdgeFit(pad.target, Projection(VGA)).fit(pixels, Pose(rotation, position, np.eye(6), "corners", 4, 0.1))
    assert found.inliers > 0.985  # 0.957 with the edges beside the inner tag's paper

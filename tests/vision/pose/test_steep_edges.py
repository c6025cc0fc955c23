"""Edges in views onto a corner of a print at a slant, where its normals are not those of its edges in the image."""

from __future__ import annotations

import numpy as np
import pytest

from lab.vision.flight import VGA
from lab.vision.stills import error_of, target_named
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.edgemodel import EdgeModel, seen_across
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import CLEAN
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import view_towards


def slanted(tilt_deg: float, around_deg: float) -> np.ndarray:
    """Direction `(3,)` a print is seen from."""
    tilt, around = np.radians([tilt_deg, around_deg])
    return np.array([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)])


@pytest.mark.parametrize("name", ["single", "nested"])
@pytest.mark.parametrize("tilt", [45.0, 58.0])
@pytest.mark.parametrize("around", [45.0, 30.0])
def test_a_slanted_view_onto_a_corner_ends_at_the_place(name: str, tilt: float, around: float) -> None:
    pad = SceneTarget.of(target_named(name), Platform())
    view = view_towards(VGA, 1.2 * slanted(tilt, around), np.zeros(3))
    rotation, position = cam_from_target(pad, view)
    pixels = Scene([pad], ground=None, seed=4, fine=False).render(view, CLEAN)
    fitter = EdgeFit(pad.target, Projection(VGA))
    for axis in range(3):
        for off in (-0.015, 0.015):
            start = turn(rotation, off * np.eye(3)[axis])
            found = fitter.fit(pixels, Pose(start, 1.003 * position, np.eye(6), "corners", 4, 0.1))
            error = error_of(found.rotation, found.position, rotation, position)
            assert error.angle_deg < 0.03  # 0.1-1 degree along the normals of the print
            off_by = np.array([*error.xyz, *error.rpy])
            assert off_by @ np.linalg.solve(found.covariance, off_by) / 6 < 4.0


def test_normals_in_the_image_stand_across_edges_and_point_to_the_brighter_side() -> None:
    pad = SceneTarget.of(target_named("nested"), Platform())
    rotation, position = cam_from_target(pad, view_towards(VGA, 1.2 * slanted(60.0, 45.0), np.zeros(3)))
    model, projection = EdgeModel.of(pad.target), Projection(VGA)

    def seen(points: np.ndarray) -> np.ndarray:
        return projection.project(points @ rotation.T + position)[0]

    normals, cell_px = seen_across(seen(model.stepped))
    near = 0.01 * model.cell[:, None]
    along = seen(model.points + near * model.tangents) - seen(model.points - near * model.tangents)
    across = seen(model.points + near * model.normals) - seen(model.points - near * model.normals)
    np.testing.assert_allclose((normals * along).sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose((normals * normals).sum(axis=1), 1.0)
    height = (normals * across).sum(axis=1) / 0.02
    assert bool((height > 0.0).all())
    np.testing.assert_allclose(cell_px, height, rtol=0.02)
    slant = np.degrees(np.arccos(height * 0.02 / np.linalg.norm(across, axis=1)))
    assert 30.0 < float(np.median(slant)) < 45.0

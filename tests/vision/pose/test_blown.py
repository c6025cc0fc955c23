"""Edges whose bright side is blown: a highlight on a glossy print does not turn the pose."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.sim.scene.gloss import Gloss
from mkdaemon.sim.scene.light import Conditions
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefind import FoundEdges, Samples, find_edges
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from tests.vision.views import VGA, View, place, shipped

TARGET = replace(shipped("nested"), bend=0.0)
COUNT = 60
CONTRAST = 150.0
EDGE_AT = 32.3
FINE = 8
"""Sub-samples a pixel."""


def edge(seen: float, growing: float = 0.0) -> FoundEdges:
    """An upright edge in an image whose paper is blown below row 32, where `seen` of the contrast is left.

    Args:
        seen: share of the contrast.
        growing: of the light along x [grey/px].
    """
    place = np.arange(64 * FINE) / FINE - 0.5 + 0.5 / FINE
    sharp = (place > EDGE_AT).astype(np.float32)[None]
    blurred = cv2.GaussianBlur(sharp, (0, 0), 0.6 * FINE)[0].reshape(64, FINE).mean(axis=1)
    rise = CONTRAST * blurred + growing * (np.arange(64) - EDGE_AT)
    rows = np.vstack([np.tile(50.0 + rise, (32, 1)), np.tile(255.0 - seen * CONTRAST + rise, (32, 1))])
    samples = Samples(
        np.arange(COUNT),
        np.column_stack([np.full(COUNT, 32.0), np.linspace(2.0, 61.0, COUNT)]),
        np.tile([1.0, 0.0], (COUNT, 1)),
        np.full(COUNT, 2.5),
        np.zeros((COUNT, 6)),
        np.zeros(COUNT),
        np.full(COUNT, 30.0),
        np.ones(COUNT, dtype=bool),
    )
    return find_edges(np.clip(np.rint(rows), 0, 255).astype(np.uint8), samples, LIMITS, is_blown=True)


@pytest.mark.parametrize("seen", [0.9, 0.7, 0.5, 0.35])
@pytest.mark.parametrize("growing", [-1.5, 0.0, 1.5])
def test_a_blown_edge_is_found_where_a_whole_one_is(seen: float, growing: float) -> None:
    found = edge(seen, growing)
    assert found.found.all()
    assert abs(found.offsets[-1] - found.offsets[0]) < 0.15
    assert found.blown is not None
    assert found.blown.clear[-1] < found.blown.clear[0]


def test_nothing_is_moved_where_no_paper_is_blown() -> None:
    assert edge(1.3).blown is None


@pytest.mark.parametrize(("beside", "distance"), [(0.12, 1.6), (0.12, 2.3), (0.15, 2.3), (0.15, 2.8)])
def test_a_highlight_does_not_turn_the_pose(beside: float, distance: float) -> None:
    """It lies over one side of a print seen from nearly above; without what clipping does 2.8 to 7.6 degrees."""
    gloss = Gloss(0.06, (np.sin(beside), 0.0, np.cos(beside)))
    view = View(TARGET, place(distance, 0.03, around=7.0 * beside), Conditions(gloss=gloss))
    turned = turn(view.rotation, np.radians([0.6, -0.5, 0.4]))
    start = Pose(turned, 1.002 * view.position, 1e-6 * np.eye(6), "edges", 200, 0.05)
    pose = EdgeFit(TARGET, Projection(VGA)).fit(view.pixels, start)
    assert pose is not None
    turn_left = cv2.Rodrigues(view.rotation @ pose.rotation.T)[0].ravel()
    error = np.concatenate([view.position - pose.position, turn_left])
    assert np.degrees(np.linalg.norm(turn_left)) < 1.5
    assert float(error @ np.linalg.solve(pose.covariance, error)) / 6 < 4.5
    assert pose.inliers > LIMITS.agreement.blind

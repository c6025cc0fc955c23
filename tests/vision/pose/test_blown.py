"""Edges whose bright side is blown: a highlight on a glossy print does not turn the pose."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefind import FoundEdges, find_edges
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.gloss import Gloss
from mksim.scene.light import LightConditions
from tests.vision.views import VGA, View, angle_deg, nearly, nees, place, shipped

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
        np.full(COUNT, 30.0),
        np.ones(COUNT, dtype=bool),
    )
    return find_edges(np.clip(np.rint(rows), 0, 255).astype(np.uint8), samples)


@pytest.mark.parametrize("seen", [0.9, 0.7, 0.5, 0.35])
@pytest.mark.parametrize("growing", [-1.5, 0.0, 1.5])
def test_a_blown_edge_is_found_where_a_whole_one_is(seen: float, growing: float) -> None:
    found = edge(seen, growing)
    assert found.found.all()
    assert abs(found.offsets[-1] - found.offsets[0]) < 0.15
    assert found.blown == 0.5
    assert found.trust[-1] < found.trust[0]


def test_nothing_is_moved_where_no_paper_is_blown() -> None:
    found = edge(1.3)
    assert found.blown == 0.0
    assert found.light is None


@pytest.mark.parametrize(("beside", "distance"), [(0.12, 1.6), (0.12, 2.3), (0.15, 2.3), (0.15, 2.8)])
def test_a_highlight_does_not_turn_the_pose(beside: float, distance: float) -> None:
    """It lies over one side of a print seen from nearly above; without what clipping does 2.8 to 7.6 degrees."""
    gloss = Gloss(0.06, (np.sin(beside), 0.0, np.cos(beside)))
    view = View(TARGET, place(distance, 0.03, around=7.0 * beside), LightConditions(gloss=gloss))
    pose = EdgeFit(TARGET, Projection(VGA)).fit(view.pixels, nearly(view))
    assert angle_deg(view.rotation, pose.rotation) < 1.5
    assert nees(view, pose, pose.covariance) < 5.5
    assert pose.inliers > LIMITS.agreement.blind


OVER = LightConditions(exposure=1.8)


def test_motion_moves_blown_edges_across_it_only() -> None:
    """Edges of one way are wider and clipped farther from their middle: one blur for both turned poses by 1.1 deg."""
    off, surprise = [], []
    for around in (0.0, 1.3, 2.6):
        rate = 2.4 / VGA.fx / 0.004 * np.array([np.sin(around), np.cos(around), 0.0])
        view = View(TARGET, replace(place(2.9, 0.15, around), rate_cam=rate, exposure_time=0.004), OVER)
        pose = EdgeFit(TARGET, Projection(VGA)).fit(view.pixels, nearly(view))
        off.append(angle_deg(view.rotation, pose.rotation))
        surprise.append(nees(view, pose, pose.covariance))
    assert np.mean(off) < 0.5
    assert np.mean(surprise) < 1.5


def test_blown_paper_tells_grey_values_nothing() -> None:
    """Fitted as if it ended at the largest grey value it put a print 3 to 4 mm too near or too far at 5 m."""
    views = [View(TARGET, place(5.0, tilt, 7.0 * tilt), OVER) for tilt in (0.05, 0.15, 0.25, 0.35)]
    found = [(view, PhotoFit(TARGET, Projection(VGA)).fit(view.pixels, nearly(view))) for view in views]
    assert np.mean([nees(view, pose, pose.covariance) for view, pose in found if pose is not None]) < 3.0
    assert all(pose is not None and pose.likeness is not None and pose.likeness > 0.95 for _, pose in found)


@pytest.mark.parametrize(("exposure", "source"), [(1.8, "photometric"), (1.0, "edges")])
def test_small_cells_of_blown_paper_are_measured_by_grey_values(exposure: float, source: str) -> None:
    """Their corners are dimmer and clipped less: edges of 5 px cells put the print 4 mm too far, 1.6 claimed."""
    view = View(TARGET, place(4.4, 0.2), LightConditions(exposure=exposure))
    pose = TargetFitter(TARGET, Projection(VGA)).refine(view.pixels, nearly(view))
    assert pose.source == source
    assert nees(view, pose, pose.covariance) < 3.0

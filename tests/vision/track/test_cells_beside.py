"""A fit may settle whole cells of a small tag beside its place, or on a dark tile: black and white tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import CellEvidence
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import Tag
from mkdaemon.vision.track.attitude import ImageSight
from mkdaemon.vision.track.judge import Judge
from mkdaemon.vision.track.level import LevelKnowledge
from tests.vision.views import VGA, View, assert_near, place, shipped, start_at

CFG = TrackerSection()


def eyes(view: View, name: str, pixels=None) -> tuple[TargetFitter, Callable[[Pose], PoseRefusal | None]]:
    """A fitter of a target, and why a judge refuses a pose in an image."""
    fitter, level = TargetFitter(shipped(name), Projection(VGA)), LevelKnowledge(True, LOOKING_DOWN, CFG)
    seen = ImageSight(view.pixels if pixels is None else pixels, 0.03, view.view.enu_from_cam)
    return fitter, lambda pose: Judge(fitter, level, CFG).refusal(seen, pose, None)


CELLS_BESIDE = [("nested", 0.8, (2, 0)), ("nested", 1.1, (0, -2)), ("nested", 1.4, (2, 0)), ("nested-36", 0.9, (0, -2))]


def beside(view: View, tag: Tag, cells: tuple[float, float]) -> Pose:
    """The pose that puts a target cells of one of its tags beside its place."""
    step = tag.module * np.array([*cells, 0])
    return replace(start_at(view), position=view.position + view.rotation @ step)


@pytest.mark.parametrize(("name", "distance", "cells"), CELLS_BESIDE)
def test_a_pose_two_cells_of_the_inner_tag_beside_its_place_is_refused(name, distance, cells):
    """A fit that begins there ends at the place."""
    view = View(shipped(name), place(distance, 0.2))
    fitter, refusal = eyes(view, name)
    start = beside(view, shipped(name).tags[1], cells)
    doubted = replace(start, inliers=0.5)  # as of a fit that stays there
    assert fitter.cells.evidence(view.pixels, doubted).vouches, "all cells together do not tell"
    assert fitter.cells.beside(view.pixels, doubted) > HALF * LIMITS.ambiguity.decided
    assert refusal(doubted) is PoseRefusal.BITS
    assert_near(fitter.refine(view.pixels, start), view, m=1e-3)


@pytest.mark.parametrize("texture", ["grey", "noise"])
def test_a_right_pose_with_the_inner_tag_hidden_stays(texture):
    target, view = shipped("nested"), View(shipped("nested"), place(0.8, 0.2))
    corners, _ = Projection(VGA).project(1.4 * target.tags[1].corners @ view.rotation.T + view.position)
    cover = np.full_like(view.pixels, 120)
    if texture == "noise":
        cover = np.random.default_rng(4).integers(0, 256, cover.shape, dtype=np.uint8)
    hidden = cv2.fillConvexPoly(np.zeros_like(cover), np.rint(corners).astype(np.int32), 1)
    pixels = np.where(hidden > 0, cover, view.pixels)
    fitter, refusal = eyes(view, "nested", pixels)
    pose = fitter.refine(pixels, start_at(view))
    assert_near(pose, view, m=1e-3)
    assert fitter.cells.beside(pixels, pose) == 0.0
    assert refusal(pose) is None


def test_cells_outside_the_image_or_too_small_tell_nothing():
    view = View(shipped("nested"), place(0.8, 0.2))
    cells, pose = eyes(view, "nested")[0].cells, start_at(view)
    far = replace(pose, position=20.0 * view.position)
    for one in (replace(pose, position=view.position + np.array([5.0, 0.0, 0.0])), far):
        assert cells.evidence(view.pixels, one) == CellEvidence()
    assert cells.beside(view.pixels, far) == 0.0


def turned_away(distance: float, toward: float, way: float = 1.0, tilt: float = 0.2) -> View:
    """A view of a target `way` to the border of the image or beyond, `toward` [rad] from its x axis."""
    ahead = place(distance, tilt)
    heading = np.array([np.cos(toward), np.sin(toward)])
    half = np.array([VGA.width / VGA.fx, VGA.height / VGA.fy]) / 2
    aside, down = np.arctan(way * heading * float(np.min(half / np.abs(heading))))
    turned = cv2.Rodrigues(np.array([0.0, -aside, 0.0]))[0] @ cv2.Rodrigues(np.array([down, 0.0, 0.0]))[0]
    return View(shipped("nested"), replace(ahead, enu_from_cam=ahead.enu_from_cam @ turned))


@pytest.mark.parametrize(
    ("distance", "toward", "cells"), [(1.9, 0.52, (0, 2)), (1.9, 5.76, (0, -2)), (2.2, 0.52, (0, 2))]
)
def test_a_fit_beside_the_place_of_a_target_that_leaves_the_image_is_refused(distance, toward, cells):
    view = turned_away(distance, toward)
    fitter, refusal = eyes(view, "nested")
    start = beside(view, shipped("nested").tags[0], cells)
    wrong, right = fitter.refine(view.pixels, start), fitter.refine(view.pixels, start_at(view))
    assert np.linalg.norm(wrong.position - view.position) > 0.05, "two cells on, edges agree with their neighbours'"
    assert_near(right, view, m=1e-3)
    assert (refusal(wrong), refusal(right)) == (PoseRefusal.BITS, None)


@pytest.mark.parametrize(
    ("distance", "toward", "step"), [(0.29, 4.4, -18), (0.29, 5.2, -14), (0.28, 4.6, -18), (0.29, 4.2, -16)]
)
def test_where_few_edges_agree_those_that_are_seen_have_to(distance, toward, step):
    """A corner of a near target is in view: part of a cell (mm) beside its place a few edges agree with others."""
    view = turned_away(distance, toward, 1.3, 0.35)
    fitter, refusal = eyes(view, "nested")
    start = replace(start_at(view), position=view.position + view.rotation @ np.array([0.0, 1e-3 * step, 0.0]))
    wrong, right = fitter.refine(view.pixels, start), fitter.refine(view.pixels, start_at(view))
    assert np.linalg.norm(wrong.position - view.position) > 0.01
    assert wrong.inliers < LIMITS.agreement.blind
    assert not fitter.edges.evidence(view.pixels, wrong).explains
    assert refusal(wrong) in (PoseRefusal.INLIERS, PoseRefusal.RESIDUAL)
    assert_near(right, view, m=1e-3)
    assert refusal(right) is None


def test_a_target_that_is_covered_by_half_shows_the_other_edges_where_they_are():
    view, half = View(shipped("nested"), place(0.8, 0.2)), [[-1, 0.06, 0], [1, 0.06, 0], [1, -1, 0], [-1, -1, 0]]
    corners, _ = Projection(VGA).project(np.array(half) @ view.rotation.T + view.position)
    hidden = cv2.fillConvexPoly(np.zeros_like(view.pixels), np.rint(corners).astype(np.int32), 1)
    pixels, (fitter, _) = np.where(hidden > 0, np.uint8(120), view.pixels), eyes(view, "nested")
    pose = fitter.refine(pixels, start_at(view))
    assert_near(pose, view, m=1e-3)
    assert pose.inliers < LIMITS.agreement.blind
    assert fitter.edges.evidence(pixels, pose).explains


def painted(view: View, quad: np.ndarray, grey: int) -> np.ndarray:
    """The image with a part of the target in one grey value, by its corners `(4, 3)` [m; target]."""
    seen, _ = Projection(VGA).project(quad @ view.rotation.T + view.position)
    return cv2.fillConvexPoly(view.pixels.copy(), np.round(seen * 16).astype(int), grey, cv2.LINE_AA, shift=4)


@pytest.mark.parametrize("name", ["nested", "single"])
def test_a_border_around_nothing_is_no_target_and_half_a_code_in_view_is_one(name):
    view, outline = View(shipped(name), place(3.0, 0.2)), shipped(name).tags[0].outline
    tile = painted(view, outline, int(np.percentile(view.pixels, 1)))
    (fitter, refusal), partial = eyes(view, name, tile), replace(start_at(view), inliers=0.7)
    read = fitter.cells.evidence(tile, partial)
    assert read.code <= 0.0 < read.odds and not read.has_code
    assert refusal(partial) is PoseRefusal.BITS
    half = outline.copy()
    half[1:3] = (half[[0, 3]] + half[1:3]) / 2
    covered = painted(view, half, 90)
    assert fitter.cells.evidence(covered, replace(start_at(view), inliers=0.6)).has_code

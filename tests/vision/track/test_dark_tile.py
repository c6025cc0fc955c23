"""A dark tile as large as a tag has its border, and nothing inside: no cover makes that a tag."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.projection import Projection
from tests.vision.track.test_cells_beside import judge_of, sight, truth
from tests.vision.views import VGA, View, place, shipped


def painted(view: View, quad: np.ndarray, grey: int) -> np.ndarray:
    """The image with a part of the target in one grey value, by its corners `(4, 3)` [m; target]."""
    seen, _ = Projection(VGA).project(quad @ view.rotation.T + view.position)
    return cv2.fillConvexPoly(view.pixels.copy(), np.round(seen * 16).astype(int), grey, cv2.LINE_AA, shift=4)


@pytest.mark.parametrize("name", ["nested", "single"])
def test_a_border_around_nothing_is_no_target(name):
    view = View(shipped(name), place(3.0, 0.2))
    fitter, dark = TargetFitter(shipped(name), Projection(VGA)), int(np.percentile(view.pixels, 1))
    tile = painted(view, shipped(name).tags[0].outline, dark)
    partial = replace(truth(view), inliers=0.7)
    read = fitter.cells.evidence(tile, partial)
    assert read.code <= 0.0 < read.odds and not read.has_code
    assert judge_of(fitter).refusal(sight(view, tile), partial, None) is PoseRefusal.BITS


@pytest.mark.parametrize("name", ["nested", "single"])
def test_half_a_code_in_view_is_one(name):
    view = View(shipped(name), place(3.0, 0.2))
    fitter, half = TargetFitter(shipped(name), Projection(VGA)), shipped(name).tags[0].outline.copy()
    half[1:3] = (half[[0, 3]] + half[1:3]) / 2
    covered = painted(view, half, 90)
    assert fitter.cells.evidence(covered, replace(truth(view), inliers=0.6)).has_code

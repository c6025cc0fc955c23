"""Light that grows over a print moves its edges; edges of small cells are shifted by another amount than large ones."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.vision.pose.edgefit import EdgeFit, shifts
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import Unknowns
from mksim.scene.light import LightConditions
from mksim.scene.processing import Processing
from tests.vision.views import VGA, View, place, shipped

TARGET = shipped("nested")
PROJECTION = Projection(VGA)


def fitted(view: View, pixels: np.ndarray) -> Pose:
    found = EdgeFit(TARGET, PROJECTION).fit(
        pixels, Pose(view.rotation, 1.002 * view.position, 1e-6 * np.eye(6), "edges", 200, 0.05)
    )
    assert found is not None
    return found


def farther(view: View, pixels: np.ndarray) -> float:
    """Error of the range [m]."""
    return float(np.linalg.norm(fitted(view, pixels).position) - np.linalg.norm(view.position))


def lit(view: View, lost: float) -> np.ndarray:
    """The image with less light away from the middle of the target: a share `lost` at 60 px, as behind a mark."""
    middle = PROJECTION.project(view.position[None])[0][0]
    y, x = np.indices(view.pixels.shape)
    light = 1.0 - lost * ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / 60.0**2
    return np.rint(view.pixels * np.clip(light, 0.1, 1.0)).astype(np.uint8)


@pytest.mark.parametrize("distance", [2.2, 2.8, 4.2])
def test_light_that_falls_towards_the_rims_does_not_make_a_print_smaller(distance: float) -> None:
    view = View(TARGET, place(distance, 0.2))
    shares = [farther(view, lit(view, lost)) - farther(view, view.pixels) for lost in (0.2, 0.4)]
    assert np.abs(shares).max() < 0.0004 * distance


def test_light_that_may_move_edges_is_in_the_covariance() -> None:
    view = View(TARGET, place(3.6, 0.2))
    even, uneven = fitted(view, view.pixels), fitted(view, lit(view, 0.5))
    assert uneven.covariance[2, 2] > 2.0 * even.covariance[2, 2]
    # The light of this image moves nothing sideways, that of one with another mark does.
    assert uneven.covariance[0, 0] > 1.35 * even.covariance[0, 0]


def shaded(view: View, pixels: np.ndarray) -> np.ndarray:
    """The image with three tenths of the light on the right of the target."""
    middle = PROJECTION.project(view.position[None])[0][0]
    y, x = np.indices(pixels.shape)
    return np.where(x - middle[0] + 0.3 * (y - middle[1]) > 10.0, np.rint(0.3 * pixels), pixels).astype(np.uint8)


@pytest.mark.parametrize("distance", [2.2, 2.8])
def test_light_that_grows_is_asked_for_beside_a_shadow_too(distance: float) -> None:
    """At a first look a shadow's rim is so far off what even light explains that it seemed to explain nothing."""
    view = View(TARGET, place(distance, 0.2))
    for pixels, grows in ((view.pixels, False), (shaded(view, lit(view, 0.4)), True)):
        located = EdgeFit(TARGET, PROJECTION).locate(pixels, fitted(view, pixels))
        assert ("grown" in located[2]) == grows


@pytest.mark.parametrize("distance", [1.0, 1.2, 1.4])
def test_small_cells_behind_a_tone_curve_do_not_shift_large_ones(distance: float) -> None:
    """One shift for both tags: 0.5 to 0.8 mm."""
    view = View(TARGET, place(distance, 0.2), LightConditions(processing=Processing(gamma=2.2)))
    assert abs(farther(view, view.pixels)) < 0.0004


def test_what_is_known_of_shifts_is_weighed_by_the_edges_of_the_image() -> None:
    """Weighed as in a bad image, 0.1 px held the shift of small cells that are trusted little."""
    line = shifts(np.ones(4), np.array([[True, True, False, False]]))
    assert line.rows.tolist() == [[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]]
    normal, _ = Unknowns([line]).equations(np.zeros(4), np.zeros(4), 0.05**2)
    assert np.diag(normal) == pytest.approx([0.0625, 0.0625])

"""What an image says for a pose against its mirror image."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import evidence, facts, log_odds, mirror_odds, residual_ratio
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from tests.vision.views import angle_deg

DOWN = np.diag([1.0, -1.0, -1.0])
"""A target straight under a camera that looks down."""
FOCAL_PX = 600.0


def tilted(degrees: float, loss: float, points: int = 200) -> Pose:
    rotation = turn(DOWN, np.radians([degrees, 0, 0]))
    return Pose(rotation, np.array([0.1, 0.0, 3.0]), np.eye(6) * 1e-4, "edges", points, np.sqrt(loss), loss=loss)


DECIDED = LIMITS.ambiguity.decided


@pytest.mark.parametrize(
    ("second", "odds"),
    [
        (tilted(-10, 0.09), DECIDED),
        (tilted(-10, 0.012), 0.4),  # what may be light or blur says less
        (tilted(-10, 0.0101), 0.0),
        (tilted(-10, 0.09, 20), 0.62),  # too few samples to believe a residual
        (tilted(-10, 0.005), 0.0),  # the image likes the other one better
    ],
)
def test_an_image_decides_by_residuals_and_by_how_many_there_are(second, odds):
    assert evidence(tilted(10, 0.01), second) == pytest.approx(odds, abs=0.02)


@pytest.mark.parametrize(
    ("rms", "inliers", "source", "decides"),
    [
        (0.08, 1.0, "photometric", True),
        (0.3, 1.0, "photometric", False),  # something is not modelled, and may take sides
        (0.08, 0.85, "photometric", False),  # something lies over the target
        (0.08, 1.0, "edges", False),
    ],
)
def test_odds_decide_alone_where_a_fit_leaves_only_noise(rms, inliers, source, decides):
    marks = {"rms_px": rms, "inliers": inliers, "source": source}
    first, second = replace(tilted(10, 9.0, 600), **marks), replace(tilted(-10, 11.0, 600), **marks)
    assert log_odds(first, second) > DECIDED
    assert (evidence(first, second) == DECIDED) == decides
    assert evidence(first, replace(second, loss=9.5)) < DECIDED


@pytest.mark.parametrize(("losses", "ratio"), [((0.04,), 2.0), ((0.09, 0.04), 2.0), ((), np.inf)])
def test_the_ratio_is_that_of_the_best_other_reading(losses, ratio):
    same = tilted(10.3, 0.02)
    assert residual_ratio(tilted(10, 0.01), [same, *(tilted(-10, loss) for loss in losses)]) == pytest.approx(ratio)


@pytest.mark.parametrize(
    ("side_px", "tilt_deg"), [(60.0, 15.0), (60.0, 30.0), (60.0, 50.0), (100.0, 20.0), (100.0, 40.0), (30.0, 60.0)]
)
def test_a_mirror_image_is_as_far_off_as_perspective_says(side_px, tilt_deg):
    """Points of a square, fitted from the mirror image of their pose, are off by so much across edges."""
    side = (np.arange(20) + 0.5) / 20 - 0.5
    points = np.array([(x, y, 0.0) for x in side for y in side])
    camera, place = np.diag([FOCAL_PX, FOCAL_PX, 1.0]), np.array([0.0, 0.0, FOCAL_PX / side_px])
    turned, mirrored = (cv2.Rodrigues(tilted(angle, 0.0).rotation)[0] for angle in (tilt_deg, -tilt_deg))
    seen = cv2.projectPoints(points, turned, place, camera, None)[0]
    rival = cv2.solvePnPRefineLM(points, seen, camera, None, mirrored.copy(), place.copy())
    left = cv2.projectPoints(points, *rival, camera, None)[0] - seen
    off_px = np.sqrt((left**2).mean())
    sharp = replace(tilted(tilt_deg, 0.0), position=place, rms_px=0.02)
    said = np.sqrt(2.0 * np.exp(2.0 * mirror_odds(sharp, 1.0, FOCAL_PX) / facts(200, 1.0)) - 1.0) * sharp.rms_px
    assert 0.8 < said / off_px <= 1.05


def test_attitude_is_interpolated_and_not_made_up():
    history = AttitudeHistory([AttitudeSample(1.0, 0.0, 0.0, 3.1), AttitudeSample(1.1, 0.1, 0.0, -3.1)])
    turned = angle_deg(history.at(1.05, 0.25), history.at(1.0, 0.25))
    assert turned == pytest.approx(np.degrees(np.hypot(0.05, (2 * np.pi - 6.2) / 2)), abs=0.1)
    assert np.allclose(history.at(1.2, 0.25), history.at(1.1, 0.25))
    gap = AttitudeHistory([AttitudeSample(0.0, 0, 0, 0), AttitudeSample(10.0, 1, 0, 0)])
    assert [history.at(2.0, 0.25), AttitudeHistory([]).at(0.0, 1.0), gap.at(5.0, 0.25)] == [None] * 3


def grey(degrees: float, cost: float, shared: float = 1.2, common: float = 0.1, loss: float = 9.0) -> Pose:
    """A fit to grey values that leaves what `common` says beside noise."""
    pose = replace(tilted(degrees, loss, 700), source="photometric", rms_px=0.06)
    return replace(pose, cost=cost, shared=shared, common=common)


def test_why_a_reading_is_wrong_does_not_speak_for_it():
    """The residuals of a mirror image are shared by neighbours because it lies elsewhere: no noise is."""
    true = grey(10, 3.7)
    odds = log_odds(true, grey(-10, 5.0, shared=5.0, common=0.7, loss=10.0))
    assert odds == log_odds(true, grey(-10, 5.0, loss=10.0))
    assert odds > LIMITS.ambiguity.decided
    assert evidence(true, grey(-10, 5.0, shared=5.0, common=0.7, loss=10.0)) == DECIDED

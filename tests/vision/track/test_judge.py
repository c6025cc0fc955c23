"""What the judges decide: tables of given fits, and images where black and white tell a fit beside its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgefit import EdgeEvidence
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import CellEvidence
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import Tag, Target
from mkdaemon.vision.track.attitude import ImageSight
from mkdaemon.vision.track.judge import FitVerdict, Judge
from mkdaemon.vision.track.level import LevelKnowledge
from tests.vision.views import VGA, View, angle_deg, assert_near, place, shipped, start_at

PIXELS = np.zeros((480, 640), np.uint8)
LEVEL = LOOKING_DOWN.flu_from_cam.T
"""Camera from a level target, the vehicle level."""
SHARP = np.diag([1e-7, 1e-7, 1e-6, 1e-7, 1e-7, 1e-7])
STEP = 1 / 30


def fitted(distance: float = 3.0, tilt_deg: float = 0.0, **change: Any) -> Pose:
    """A good edge fit of a target straight ahead."""
    rotation = turn(LEVEL, np.radians([tilt_deg, 0.0, 0.0]))
    pose = Pose(rotation, np.array([0.0, 0.0, distance]), SHARP, "edges", 200, 0.05, loss=0.01, blur_px=1.75)
    return replace(pose, **change)


def mirrored(pose: Pose, loss: float = 0.01) -> Pose:
    """Its mirror image about the line of sight, for a target straight ahead tilted about x."""
    tilt = np.arctan2(pose.rotation[1, 2], -pose.rotation[2, 2])
    return replace(pose, rotation=turn(pose.rotation, np.array([2 * tilt, 0.0, 0.0])), loss=loss)


CLEAR, UNCLEAR = CellEvidence(30.0, 40.0, 30.0), CellEvidence(10.0, 20.0, 10.0)
UNREAD, UNKNOWN = CellEvidence(-4.0, 20.0, -4.0), CellEvidence()


class Answers:
    """Cells or edges that answer what the test says."""

    def __init__(self, evidence: CellEvidence | EdgeEvidence, beside: float = 0.0) -> None:
        self.evidence, self.beside = (lambda _pixels, _pose: evidence), (lambda _pixels, _pose: beside)


@dataclass
class GivenFits:
    """A fitter that answers what the test says."""

    free: Pose | None = None
    held: Pose | None = None
    mirror: Pose | None = None
    read: CellEvidence = CLEAR
    beside_nats: float = 0.0
    mirror_nats: float = 0.0
    cell_px: float = 10.0
    grey: list[Pose] = field(default_factory=list)
    supported: bool = False
    explains: bool = True
    target: Target = field(default_factory=lambda: shipped("single"))

    def refine(self, pixels, start, level=None):
        return self.free if level is None else self.held

    def is_small(self, pose):
        return self.cell_px < LIMITS.cells.mixed_px

    def fit_mirrored(self, pixels, pose):
        return self.mirror

    def mirror_odds(self, pixels, pose):
        return self.mirror_nats

    def fit_grey_values(self, pixels, rivals):
        return self.grey

    @property
    def cells(self):
        return Answers(self.read, self.beside_nats)

    @property
    def edges(self):
        return Answers(EdgeEvidence(seen=float(self.supported), agreeing=float(self.explains)))

    def side_px(self, pose):
        return self.cell_px * self.target.tags[0].family.size_cells


def judge_of(fits: GivenFits) -> Judge:
    cfg = TrackerSection()
    return Judge(fits, LevelKnowledge(True, LOOKING_DOWN, cfg), cfg)  # type: ignore[arg-type]


def sight(time: float = STEP, attitude: bool = True) -> ImageSight:
    return ImageSight(PIXELS, time, LOOKING_DOWN.flu_from_cam if attitude else None)


def measured(free: Pose | None, held: Pose | None = None, **given: Any) -> FitVerdict:
    """The verdict about a followed target's fits beside an attitude."""
    return judge_of(GivenFits(free, held, **given)).measure(sight(), fitted())


@pytest.mark.parametrize(
    ("pose", "refusal", "is_kept"),
    [
        (fitted(), None, True),
        (None, PoseRefusal.NO_FIT, False),
        (fitted(inliers=0.2), PoseRefusal.INLIERS, False),
        (fitted(points=20), PoseRefusal.POINTS, False),
        (fitted(rms_px=1.2), PoseRefusal.RESIDUAL, False),
        (fitted(step=0.03), PoseRefusal.STEP, False),
        (fitted(tilt_deg=5.0), None, True),  # a deck may be tilted
        (fitted(tilt_deg=7.0), PoseRefusal.ATTITUDE, False),
        (fitted(covariance=SHARP + np.diag([0, 0, 0, 0, 0, 1e-3])), PoseRefusal.ANGLE_UNCERTAIN, True),
        (fitted(covariance=SHARP + np.diag([4e-4, 0, 0, 0, 0, 0])), PoseRefusal.POSITION_UNCERTAIN, True),
        (fitted(covariance=SHARP + np.diag([1e-4, 0, 0, 0, 0, 0])), None, True),
    ],
    ids=lambda value: str(value)[:24],
)
def test_a_fit_beside_an_attitude(pose, refusal, is_kept):
    """A gate stops a fit for good; one that is only uncertain is followed and not published."""
    verdict = measured(pose)
    assert verdict.refusal is refusal
    assert (verdict.pose is not None and not verdict.contradicts) == is_kept


@pytest.mark.parametrize(
    ("cells", "beside", "inliers", "explains", "refusal"),
    [
        (CLEAR, 0.0, 0.7, True, None),
        (UNCLEAR, 0.0, 0.7, True, None),  # half of what they could say
        (UNREAD, 0.0, 0.7, True, PoseRefusal.BITS),
        (UNREAD, 0.0, 0.95, True, PoseRefusal.BITS),
        (CLEAR, 7.0, 0.7, True, PoseRefusal.BITS),  # one is read beside
        (CLEAR, 3.0, 0.7, True, None),
        (CLEAR, 7.0, 0.95, True, None),  # nearly all edges agree
        (UNKNOWN, 0.0, 0.7, True, None),
        (CLEAR, 0.0, 0.5, False, PoseRefusal.INLIERS),  # few edges agree: those that are seen are asked
        (CLEAR, 0.0, 0.7, False, None),
    ],
)
def test_cells_are_asked_and_where_edges_disagree_those_beside_too(cells, beside, inliers, explains, refusal) -> None:
    verdict = measured(fitted(inliers=inliers), read=cells, beside_nats=beside, explains=explains)
    assert verdict.refusal is refusal


@pytest.mark.parametrize(
    ("free", "held", "refusal"),
    [
        (fitted(tilt_deg=6.0, inliers=0.8), fitted(), None),
        (fitted(tilt_deg=6.0), fitted(), PoseRefusal.ATTITUDE),
        (None, fitted(), None),
        (fitted(tilt_deg=6.0, inliers=0.8), None, PoseRefusal.ATTITUDE),
        (fitted(tilt_deg=6.0, inliers=0.8), fitted(inliers=0.1), PoseRefusal.ATTITUDE),
    ],
)
def test_a_fit_that_follows_what_lies_on_the_target_is_tried_again_with_its_tilt_held(free, held, refusal):
    verdict = measured(free, held)
    assert verdict.refusal is refusal
    assert verdict.contradicts or (verdict.pose is not None) is (refusal is None)
    assert refusal is not None or verdict.pose.rotation is held.rotation


def test_far_away_the_attitude_is_in_the_fit_and_not_told_a_second_time():
    held = fitted(8.0, tilt_deg=1.0, covariance=np.diag([1e-6, 1e-6, 1e-4, 1.6e-3, 1.6e-3, 1e-5]))
    judge = judge_of(GivenFits(fitted(8.0, tilt_deg=6.0), held, cell_px=3.0))
    verdict = judge.measure(sight(), fitted(8.0))
    assert verdict.refusal is PoseRefusal.ANGLE_UNCERTAIN
    np.testing.assert_allclose(verdict.pose.rotation, held.rotation, atol=1e-9)
    np.testing.assert_allclose(verdict.pose.covariance, held.covariance, atol=1e-12)


TILTED = fitted(tilt_deg=12.0)


@pytest.mark.parametrize(
    ("given", "pose", "refusal"),
    [
        # large in the image: perspective tells
        ({"cell_px": 30.0}, TILTED, None),
        ({"cell_px": 30.0, "read": UNCLEAR}, replace(TILTED, inliers=0.7), PoseRefusal.INLIERS),
        ({"cell_px": 30.0, "read": CLEAR}, replace(TILTED, inliers=0.7), None),
        ({"cell_px": 30.0, "read": CLEAR}, replace(TILTED, rms_px=0.7), PoseRefusal.RESIDUAL),
        # blur hides perspective, the mirror image fits as well
        ({"cell_px": 30.0, "mirror": mirrored(TILTED)}, replace(TILTED, blur_px=4.0), PoseRefusal.AMBIGUOUS),
        # small: the mirror image fits as well, much worse, or is the same pose
        ({"mirror": mirrored(TILTED)}, TILTED, PoseRefusal.AMBIGUOUS),
        ({"mirror": mirrored(TILTED, loss=0.1)}, TILTED, None),
        ({"mirror": None}, TILTED, None),
        # on the saddle between two readings
        ({"mirror": mirrored(TILTED)}, fitted(tilt_deg=1.0), PoseRefusal.AMBIGUOUS),
        # without the mirror image nothing contradicts but the fit itself
        ({}, replace(TILTED, inliers=0.8), PoseRefusal.INLIERS),
        ({}, replace(TILTED, rms_px=0.6), PoseRefusal.RESIDUAL),
        ({}, replace(TILTED, covariance=SHARP + np.diag([0, 0, 0, 4e-4, 0, 0])), PoseRefusal.ANGLE_UNCERTAIN),
    ],
)
def test_a_fit_without_attitude(given, pose, refusal):
    """The track has no say in which of two rivals is true."""
    judge, began = judge_of(GivenFits(pose, **given)), sight(-0.1, attitude=False)
    branches = judge.branches(began, judge.candidates(began, [pose]))
    verdict = judge.measure(sight(attitude=False), pose, branches)
    assert verdict.refusal is refusal
    assert verdict.branches.is_decided == (refusal is not PoseRefusal.AMBIGUOUS)


def judged_on(judge: Judge, branches, pose: Pose, images: int) -> list[FitVerdict]:
    """Verdicts about the images after a first one, each with the branches of the one before."""
    verdicts = []
    for k in range(1, images):
        verdicts.append(judge.measure(sight(k * STEP, attitude=False), pose, branches))
        branches = verdicts[-1].branches
    return verdicts


def test_a_pose_off_the_course_is_followed_and_not_published():
    judge = judge_of(GivenFits(TILTED))
    verdicts = judged_on(judge, judge.branches(sight(0.0), [TILTED]), TILTED, 12)
    assert {verdict.refusal for verdict in verdicts} == {None}
    branches = verdicts[-1].branches
    assert branches.course[0].angle_sd < LIMITS.certainty.blind_angle_sd
    # Within what a pose this uncertain may be off for several images, and too far for what it says of itself.
    vague = SHARP + np.diag([0.0, 0.0, 0.0, 4e-5, 4e-5, 4e-5])
    aside = replace(TILTED, rotation=turn(TILTED.rotation, np.radians([1.8, 0.0, 0.0])), covariance=vague)
    verdict = judge_of(GivenFits(aside)).measure(sight(12 * STEP, attitude=False), TILTED, branches)
    assert verdict.refusal is PoseRefusal.OFF_COURSE
    assert verdict.pose is not None


@pytest.mark.parametrize(
    ("given", "candidates", "attitude", "refusal"),
    [
        ({}, [], True, PoseRefusal.NO_FIT),
        ({}, [fitted()], True, None),
        ({"read": UNREAD}, [fitted()], True, PoseRefusal.BITS),
        ({}, [fitted(tilt_deg=8.0)], True, PoseRefusal.ATTITUDE),
        # the image alone would publish it
        ({"held": fitted()}, [fitted(tilt_deg=8.0)], True, PoseRefusal.ATTITUDE),
        ({"held": fitted()}, [fitted(tilt_deg=8.0, rms_px=0.7)], True, None),
        ({"held": fitted(inliers=0.1)}, [fitted(tilt_deg=8.0)], True, PoseRefusal.ATTITUDE),
        ({}, [TILTED, mirrored(TILTED)], False, PoseRefusal.AMBIGUOUS),
        ({}, [TILTED, mirrored(TILTED, loss=0.1)], False, None),
        ({"mirror": mirrored(TILTED)}, [TILTED], False, PoseRefusal.AMBIGUOUS),
        ({"mirror": mirrored(TILTED, loss=0.1)}, [TILTED], False, None),
        ({"held": fitted()}, [fitted(inliers=0.7)], True, None),
        ({"held": fitted(tilt_deg=2.5)}, [fitted(inliers=0.7)], True, None),
        # A covered border looks like a tilted deck; a target in full view may lie on one.
        ({"held": fitted(tilt_deg=5.0)}, [fitted(inliers=0.7)], True, PoseRefusal.ATTITUDE),
        ({}, [fitted(tilt_deg=5.0)], True, None),
        ({}, [fitted(inliers=0.7)], True, PoseRefusal.ATTITUDE),
        ({"supported": False}, [replace(TILTED, inliers=0.7)], False, PoseRefusal.INLIERS),
        ({"supported": True}, [replace(TILTED, inliers=0.7)], False, None),
        ({}, [replace(TILTED, blur_px=4.0)], False, None),
        ({"cell_px": 30.0}, [replace(TILTED, blur_px=4.0)], False, None),
        ({}, [replace(TILTED, rms_px=0.7)], False, PoseRefusal.RESIDUAL),
    ],
)
def test_a_first_pose(given, candidates, attitude, refusal):
    verdict = judge_of(GivenFits(**given)).first(sight(attitude=attitude), candidates)
    assert verdict.refusal is refusal
    is_followed = refusal in (None, PoseRefusal.AMBIGUOUS, PoseRefusal.RESIDUAL)
    assert (verdict.pose is not None) == (is_followed or verdict.contradicts)


@pytest.mark.parametrize(("cell_px", "refusal"), [(6.0, None), (12.0, PoseRefusal.AMBIGUOUS)])
def test_all_pixels_decide_between_first_poses_whose_edges_do_not(cell_px, refusal):
    grey = [
        replace(TILTED, source="photometric", rms_px=0.05, loss=0.01),
        replace(mirrored(TILTED), source="photometric", rms_px=0.3, loss=0.2),
    ]
    fits = GivenFits(mirror=mirrored(TILTED), grey=grey, cell_px=cell_px)
    assert judge_of(fits).first(sight(attitude=False), [TILTED]).refusal is refusal


@pytest.mark.parametrize(
    ("loss", "is_certain", "contradicts"), [(0.001, True, True), (0.02, True, False), (0.001, False, False)]
)
def test_a_first_pose_that_the_image_alone_would_publish_contradicts_an_attitude_that_chose_its_mirror_image(
    loss, is_certain, contradicts
):
    level, uncertain = fitted(loss=0.01), SHARP + np.diag([0, 0, 0, 0, 0, 1e-3])
    off = fitted(tilt_deg=20.0, loss=loss, covariance=SHARP if is_certain else uncertain)
    verdict = judge_of(GivenFits(held=level)).first(sight(), [off, level])
    assert verdict.contradicts == contradicts
    assert angle_deg(verdict.pose.rotation, (off if contradicts else level).rotation) < 0.1
    assert verdict.refusal is (PoseRefusal.ATTITUDE if contradicts else None)


def test_a_large_residual_is_no_word_against_the_attitude_where_edges_are_hidden() -> None:
    verdict = measured(fitted(tilt_deg=23.0, inliers=0.8, rms_px=0.9), cell_px=40.0)
    assert verdict.refusal is not None
    assert verdict.pose is None


@pytest.mark.parametrize(("held_loss", "is_published"), [(0.0055, True), (0.019, False)])
def test_no_tilt_is_held_that_the_image_contradicts_however_many_edges_are_hidden(held_loss, is_published):
    """An attitude that jumped by 6 degrees while patches lay over the target turned 22 published poses in a row."""
    free = fitted(tilt_deg=7.0, inliers=0.76, loss=0.005)
    held = fitted(inliers=0.8, loss=held_loss)
    verdict = measured(free, held)
    assert (verdict.refusal is None) == is_published
    assert verdict.contradicts != is_published
    assert verdict.contradicts == (verdict.pose is free)


CFG = TrackerSection()


def eyes(view: View, name: str, pixels=None) -> tuple[TargetFitter, Callable[[Pose], PoseRefusal | None]]:
    """A fitter of a target, and why a judge refuses a pose in an image."""
    fitter, level = TargetFitter(shipped(name), Projection(VGA)), LevelKnowledge(True, LOOKING_DOWN, CFG)
    seen = ImageSight(view.pixels if pixels is None else pixels, 0.03, view.view.enu_from_cam)
    return fitter, lambda pose: Judge(fitter, level, CFG).refusal(seen, pose, None)


CELLS_BESIDE = [("nested", 1.1, (0, -2)), ("nested-36", 0.9, (0, -2))]


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


@pytest.mark.parametrize(("distance", "toward", "step"), [(0.29, 4.4, -18), (0.29, 5.2, -14)])
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

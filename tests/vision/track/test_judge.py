"""What the judges decide, as tables: fits are given, nothing is rendered."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefit import EdgeEvidence
from mkdaemon.vision.pose.gates import CellEvidence
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.tags.tagmap import TagMap, Target
from mkdaemon.vision.track.attitude import ImageSight, angle_of, fuse_normal
from mkdaemon.vision.track.branches import MOST_ODDS
from mkdaemon.vision.track.follower import Follower, TrackedFrame
from mkdaemon.vision.track.judge import FitVerdict, Judge
from mkdaemon.vision.track.level import LevelKnowledge
from mkdaemon.vision.track.tracker import Tracker
from tests.vision.views import VGA, angle_deg, shipped

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


def test_an_image_counts_once_beside_what_the_images_before_told_of_the_deck():
    pose = fitted(tilt_deg=2.0, covariance=np.diag([1e-7, 1e-7, 1e-6, 1e-4, 1e-4, 1e-7]))
    judge = judge_of(GivenFits(pose))
    expected = fuse_normal(pose, judge.level.vertical(sight()))
    verdict = judge.measure(sight(), fitted())
    np.testing.assert_allclose(verdict.pose.covariance, expected.covariance)
    assert angle_deg(verdict.pose.rotation, expected.rotation) < 1e-9
    assert verdict.alone is pose
    judge.level.learn(sight(), verdict.alone)
    assert angle_of(pose.rotation[:, 2], judge.level.vertical(sight()).up) < np.radians(1.9)


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


def test_a_track_in_doubt_goes_over_to_the_reading_that_the_images_speak_for():
    """It followed the wrong one; the other is a jump from there, and what the images say counts all the same."""
    wrong, right = fitted(tilt_deg=15.0, loss=0.016), mirrored(fitted(tilt_deg=15.0), loss=0.01)
    judge = judge_of(GivenFits(wrong, mirror=right, cell_px=4.5))
    *_, verdict = judged_on(judge, judge.branches(sight(0.0), [wrong, right]), wrong, 12)
    assert verdict.refusal is None
    assert angle_deg(verdict.pose.rotation, right.rotation) < 0.5


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


@pytest.mark.parametrize(("loss", "refusal"), [(0.01003, None), (0.0108, PoseRefusal.AMBIGUOUS)])
def test_a_reading_that_images_keep_speaking_against_is_not_published(loss, refusal):
    """Each of them says too little to count as odds: inertia may not overrule all of them together."""
    kept, other = replace(TILTED, loss=loss), mirrored(TILTED, loss=0.01)
    judge = judge_of(GivenFits(kept, mirror=other, cell_px=4.5))
    branches = replace(judge.branches(sight(0.0), [kept, other]), weight=np.array([0.0, -MOST_ODDS]))
    assert judged_on(judge, branches, kept, 30)[-1].refusal is refusal


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


@pytest.mark.parametrize(
    ("change", "cell_px", "is_there"),
    [
        ({}, 10.0, True),
        ({"inliers": 0.85}, 10.0, False),
        ({"inliers": 0.76}, 40.0, True),
        ({"inliers": 0.76}, 6.0, False),
    ],
    ids=["its edges agree", "some are hidden", "its cells are read clearly", "its cells are small"],
)
def test_a_followed_target_that_is_plainly_there_contradicts_the_attitude_that_refuses_it(change, cell_px, is_there):
    """Something lies over it, so its tilt may be misled, but not its place: the next image begins there."""
    free = fitted(tilt_deg=7.0, **change)
    verdict = measured(free, cell_px=cell_px)
    assert verdict.refusal is PoseRefusal.ATTITUDE
    assert verdict.pose is (free if is_there else None)


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


def judged_by(verdicts: list[FitVerdict], monkeypatch) -> Follower:
    """A follower whose judge says what the test says, of one start after the other."""
    follower = Tracker(TagMap((shipped("single"),)), VGA, LOOKING_DOWN).followers[0]
    none = FitVerdict(None, PoseRefusal.ATTITUDE)
    monkeypatch.setattr(follower.judge, "measure", lambda *_: verdicts.pop(0) if verdicts else none)
    for time in (-STEP, 0.0):
        follower.track.accept(ImageSight(PIXELS, time, LOOKING_DOWN.flu_from_cam), fitted())
    follower.track.decoded_at = 0.0
    return follower


@pytest.mark.parametrize(("loss", "is_published"), [(0.0055, True), (0.019, False)])
def test_no_start_leads_to_a_pose_that_the_image_likes_less_than_one_the_attitude_refused(
    monkeypatch, loss, is_published
) -> None:
    """A fit held at the tilt of an attitude that had jumped by 10 degrees was published from a second start."""
    refused, held = fitted(tilt_deg=7.0, loss=0.005), fitted(loss=loss)
    verdicts = [FitVerdict(refused, PoseRefusal.ATTITUDE), FitVerdict(held, None)]
    follower = judged_by(verdicts, monkeypatch)
    frame = TrackedFrame(sight())
    follower.follow(frame)
    assert not verdicts
    assert bool(frame.poses) == is_published
    assert follower.contradicting is (None if is_published else refused)
    assert frame.refused.get(follower.name) is (None if is_published else PoseRefusal.ATTITUDE)


def test_a_target_that_the_attitude_refuses_is_followed_only_where_no_other_start_does_better(monkeypatch) -> None:
    """A band over a border misled a fit by 23 degrees beside a right attitude, and another start found the place."""
    misled, right = fitted(tilt_deg=23.0, loss=0.3), fitted(tilt_deg=0.2)
    for verdicts, position in (
        ([FitVerdict(misled, PoseRefusal.ATTITUDE), FitVerdict(right, None)], right),
        ([FitVerdict(misled, PoseRefusal.ATTITUDE)], misled),
    ):
        follower = judged_by(list(verdicts), monkeypatch)
        monkeypatch.setattr(follower.judge, "is_plainly_there", lambda _seen, pose: pose is misled)
        frame = TrackedFrame(sight())
        follower.follow(frame)
        assert follower.track.last is position
        assert bool(frame.poses) == (position is right)


@pytest.mark.parametrize(
    ("tilt_deg", "mirror_deg", "refusal", "published_deg"),
    [
        (2.0, 12.0, None, 2.0),  # no deck is tilted like that
        (1.8, 0.0, None, 0.0),
        (4.5, 0.3, PoseRefusal.ANGLE_UNCERTAIN, 0.3),
    ],
)
def test_a_lone_first_pose_far_away_is_held_against_its_mirror_image_beside_an_attitude_too(
    tilt_deg, mirror_deg, refusal, published_deg
):
    fits = GivenFits(mirror=fitted(tilt_deg=mirror_deg))
    verdict = judge_of(fits).first(sight(), [fitted(tilt_deg=tilt_deg)])
    assert verdict.refusal is refusal
    assert angle_deg(verdict.pose.rotation, fitted(tilt_deg=published_deg).rotation) < 0.2


def test_a_first_pose_without_rival_is_followed_beside_its_mirror_image():
    """Both starts of a tag may run into one minimum; its branch alone would be believed unchallenged."""
    pose = fitted(tilt_deg=6.0)
    rival = mirrored(pose, loss=0.009)
    seen, worse = sight(attitude=False), replace(pose, loss=0.02)
    assert judge_of(GivenFits(mirror=rival)).candidates(seen, [worse, pose]) == [pose, rival]
    again = replace(rival, loss=0.02)
    assert judge_of(GivenFits(mirror=again)).candidates(seen, [pose, rival]) == [rival, pose], "it counts once"


@pytest.mark.parametrize(
    ("nats", "inliers", "cell_px", "is_asked"),
    [
        (20.0, 1.0, 10.0, False),
        (7.0, 1.0, 10.0, True),  # perspective alone does not decide
        (20.0, 0.8, 10.0, True),  # what lies over the target may hide it
        (20.0, 0.8, 30.0, False),  # not from one that is so large
    ],
)
def test_a_mirror_image_that_perspective_rules_out_is_not_fitted(nats, inliers, cell_px, is_asked):
    pose = fitted(tilt_deg=6.0, inliers=inliers)
    fits = GivenFits(mirror=mirrored(pose, loss=0.02), mirror_nats=nats, cell_px=cell_px)
    assert len(judge_of(fits).candidates(sight(attitude=False), [pose])) == 1 + is_asked

"""Inertia over a target: shaking is no motion, a mirrored pose is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import log_odds
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.track.branches import (
    CAUTION,
    MOST_ODDS,
    Branches,
    Course,
    lasting_doubt,
    places,
)
from tests.vision.views import angle_deg

DOWN = np.diag([1.0, -1.0, -1.0])
STEP = 1 / 30


def seen(centre, shake_deg=(0.0, 0.0, 0.0), *, loss=0.01, sd_deg=0.3, points=200, inliers=1.0) -> Pose:
    """A camera at `centre` [m; target] that looks down, turned by a shake."""
    rotation = turn(DOWN, np.radians(shake_deg))
    spread = np.diag([1e-6] * 3 + [np.radians(sd_deg) ** 2] * 3)
    return Pose(rotation, -rotation @ np.asarray(centre), spread, "edges", points, 0.1, inliers, loss=loss)


def mirrored(pose: Pose, loss=0.01) -> Pose:
    """The rival: the same place in the image, the normal on the other side of the line of sight."""
    axis = np.cross(pose.rotation[:, 2], -pose.position)
    turned = turn(pose.rotation, axis / np.linalg.norm(axis) * 2 * pose.tilt)
    return Pose(turned, pose.position, pose.covariance, "edges", pose.points, 0.1, pose.inliers, loss=loss)


def flown(count: int, sd_deg: float, seed: int = 1) -> tuple[Course, np.ndarray]:
    """A course after `count` shaken, noisy images of a flight at 1 m/s past the target, and the next place."""
    rng, course = np.random.default_rng(seed), None
    for k in range(count):
        pose = seen([0.6 + k * STEP, 0.2, 4.0], rng.normal(0, 1.0, 3), sd_deg=sd_deg)
        place = places([replace(pose, rotation=turn(pose.rotation, np.radians(rng.normal(0, sd_deg, 3))))])
        course = Course.begin(0.0, *place) if course is None else course.predict_at(k * STEP).join(*place)[0]
    return course.predict_at(count * STEP)[0], np.array([0.6 + count * STEP, 0.2, 4.0])


def test_shaking_stays_near_the_course_and_the_mirrored_pose_does_not():
    course, centre = flown(20, 0.3)
    for shake in ((0, 0, 0), (3, -2, 1), (-4, 4, 10)):
        true = seen(centre, shake)
        assert course.mahalanobis2(true) < 9.0
        assert course.mahalanobis2(mirrored(true)) > 50.0


@pytest.mark.parametrize("seed", range(5))
def test_a_course_knows_the_tilt_better_than_its_images(seed):
    course, centre = flown(25, 1.0, seed)
    assert np.degrees(course.angle_sd) < 1.2  # 2 degrees is what it takes each image for
    direction = np.degrees(np.arccos(course.centre @ centre / np.linalg.norm(course.centre) / np.linalg.norm(centre)))
    assert direction < 2.5 * np.degrees(course.angle_sd) * np.sqrt(2)


def test_what_is_expected_fades_with_time():
    course, _ = flown(20, 0.3)
    later = [course.predict_at(course.time + t).angle_sd for t in (0.0, 0.1, 0.3, 0.6)]
    assert later == sorted(later)
    assert later[-1] > 3 * later[0]


def test_a_vague_pose_is_moved_onto_the_course_and_a_sharp_one_stays():
    course, centre = flown(25, 0.1)
    true = seen(centre, (2, -1, 3))
    off = replace(true, rotation=turn(true.rotation, np.radians([2.0, 0, 0])))
    vague, sharp = (
        replace(off, covariance=np.diag([place_sd**2] * 3 + [np.radians(sd_deg) ** 2] * 3))
        for place_sd, sd_deg in ((1e-3, 2.0), (3e-5, 0.01))
    )
    fused = course.fuse(vague)
    assert angle_deg(fused.rotation, true.rotation) < 1.0  # the course itself is some tenths off
    assert np.linalg.norm(fused.position - true.position) < 0.005
    assert np.linalg.eigvalsh(fused.covariance)[0] > 0
    # The turn about the line of sight is nothing a place can tell.
    sight = fused.position / fused.range_m
    assert np.sqrt(sight @ fused.covariance[3:, 3:] @ sight) == pytest.approx(np.radians(2.0), rel=0.1)
    assert angle_deg(course.fuse(sharp).rotation, off.rotation) < 0.05


def test_a_course_is_believed_less_by_a_pose_that_surprises_it_and_a_pose_that_is_hidden_in_part_counts_less():
    course, centre = flown(25, 1.0)
    near, far = seen(centre, sd_deg=1.5), seen(centre + np.array([0.0, 0.3, 0.0]), sd_deg=1.5)
    assert course.mahalanobis2(near) < 3.0 < course.mahalanobis2(far) < LIMITS.certainty.deviations**2
    spread = [np.sqrt(np.linalg.eigvalsh(course.fuse(pose).covariance[3:, 3:])[1]) for pose in (near, far)]
    assert spread[1] > 1.2 * spread[0]
    course, centre = flown(20, 0.3)
    aside = centre + np.array([0.3, 0.0, 0.0])
    hidden, whole = seen(aside, inliers=0.5), seen(aside)
    moved = [course.join(*places([pose]))[0].centre[0] - course.centre for pose in (hidden, whole)]
    assert np.linalg.norm(moved[0]) < 0.7 * np.linalg.norm(moved[1])
    assert course.mahalanobis2(hidden) == pytest.approx(course.mahalanobis2(whole))


def branches_of(*loss: float, decided: bool = False, moving: bool = False) -> Branches:
    true = seen([0.7, 0.0, 4.0], loss=loss[0])
    return begun(true, mirrored(true, loss[1]), decided=decided, moving=moving)


def begun(best: Pose, other: Pose, *, decided: bool = True, moving: bool = False) -> Branches:
    """Branches of two readings; decided, the other is as unlikely as any may be."""
    branches = Branches.begin(0.0, [best, other], moving=moving)
    return replace(branches, weight=np.array([0.0, -MOST_ODDS])) if decided else branches


def fly(branches: Branches, losses, start: int = 1) -> Branches:
    """Go on past the target, the true pose and its mirror image with given losses."""
    rng = np.random.default_rng(start)
    for k, (true_loss, mirror_loss) in enumerate(losses, start):
        true = seen([0.7 + 0.3 * k * STEP, 0.0, 4.0], rng.normal(0, 0.7, 3), loss=true_loss)
        branches = branches.after(k * STEP, [mirrored(true, mirror_loss), true])
    return branches


def is_true(branches: Branches) -> bool:
    return bool(branches.course.centre[0, 0] > 0)


def test_odds_gather_until_they_decide():
    once = branches_of(0.010, 0.014)
    assert not once.is_decided
    few, many = (fly(once, [(0.010, 0.014)] * count) for count in (2, 8))
    assert 0 < few.lead < LIMITS.ambiguity.decided
    assert many.is_decided
    assert is_true(many)


def test_small_differences_decide_nothing_however_many_there_are_and_undo_no_decision():
    """Blur and light favour one of two rivals a little in every image: that is not evidence."""
    assert fly(branches_of(0.0102, 0.010), [(0.0102, 0.0100)] * 60).lead < 1e-6
    kept = fly(branches_of(0.010, 0.010, decided=True), [(0.0101, 0.0100)] * 20)
    assert kept.is_decided
    assert is_true(kept)


def test_what_images_said_against_a_reading_stays_with_a_history_that_leaps_to_it():
    """Inertia makes such a leap the likeliest history within three images of a fast flight."""
    before = fly(branches_of(0.010, 0.0106, decided=True), [(0.010, 0.0106)] * 15)
    true = seen([0.7 + 0.3 * 16 * STEP, 0.0, 4.0], loss=0.010)
    after = before.after(16 * STEP, [mirrored(true, 0.0106), true])
    is_mirrored = after.course.centre[:, 0] < 0
    assert is_mirrored.any()
    assert after.together[is_mirrored].min() > LIMITS.ambiguity.decided
    assert not after.together[~is_mirrored].any()


@pytest.mark.parametrize(("aside", "gathers"), [(0.7, True), (0.06, False)])
def test_where_two_readings_are_nearly_one_nothing_gathers_against_either(aside, gathers):
    """From nearly above a swing through the vertical makes each of them the other one."""
    losses = 0.010, 0.0106
    true = seen([aside, 0.0, 4.0], loss=losses[0])
    branches = begun(true, mirrored(true, losses[1]))
    of_one_image = log_odds(true, mirrored(true, losses[1]))
    for k in range(1, 16):
        branches = branches.after(k * STEP, [mirrored(true, losses[1]), true])
    against = float(branches.together[~branches.missed].max())
    assert (against > 3 * of_one_image) is gathers
    assert against > 0.9 * of_one_image


@pytest.mark.parametrize(
    ("lead", "together", "is_against"), [(9.7, 4.1, True), (9.7, 1.5, False), (25.0, 7.5, False), (25.0, 8.5, True)]
)
def test_a_lead_has_to_outweigh_what_images_say_together(lead, together, is_against):
    """A poor fit threw the true course aside: its mirror image led by one jump, and was published 25 degrees off."""
    branches = branches_of(0.010, 0.010)
    branches = replace(branches, weight=np.array([0.0, -lead]), together=np.array([together, 0.0]))
    assert branches.is_decided
    assert branches.is_spoken_against is is_against


def test_what_is_left_of_readings_close_by_is_told():
    """A fit that drifted over to the other reading was published 6 degrees off: its rivals lay in between."""
    branches = branches_of(0.010, 0.010)
    assert branches.doubt == pytest.approx(0.0, abs=1e-12)  # far away it is a rival, and leads or not
    state = branches.course.state.copy()
    state[1] = state[0] + 0.3 * np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    near = replace(branches, course=replace(branches.course, state=state), weight=np.array([0.0, -1.0]))
    apart = np.arctan(0.3 / np.linalg.norm(state[0, :3]))
    share = np.exp(-1.0) / (1.0 + np.exp(-1.0))
    assert near.doubt == pytest.approx(share * apart**2, rel=0.05)


def test_a_wrong_branch_is_left_after_clear_images():
    """Decided for the mirrored pose, then images that show which one is true."""
    true = seen([0.7, 0.0, 4.0])
    wrong = begun(mirrored(true), true)
    states = [fly(wrong, [(0.010, 0.020)] * n) for n in range(1, 16)]
    believed = [is_true(state) for state in states if state.is_decided]
    assert believed == sorted(believed)  # first wrong, then nobody, then true: never back
    assert believed[-1]
    assert not all(state.is_decided for state in states)


def test_one_wrong_pose_is_passed_over_and_a_lasting_one_is_followed():
    course = fly(branches_of(0.01, 0.01, decided=True), [(0.010, 0.0101)] * 6)
    aside = [seen([1.6 + 0.01 * k, 0.0, 4.0]) for k in range(4)]
    once = course.after(7 * STEP, aside[:1])
    assert once.missed[0]
    again = fly(once, [(0.010, 0.0101)], start=8)
    assert again.is_decided
    for k, pose in enumerate(aside):
        course = course.after((7 + k) * STEP, [pose])
    for found, east in ((again, 0.78), (course, 1.63)):
        assert not found.missed[0]
        assert np.linalg.norm(found.course.centre[0] - [east, 0.0, 4.0]) < 0.05


def test_copies_of_a_reading_leave_room_for_the_true_one():
    """A far target that passes head on: five of six branches were one reading, published 11 degrees off."""
    first = seen([0.4, 0.1, 6.0], sd_deg=0.9)
    branches = Branches.begin(0.0, [first, replace(first)])
    assert len(branches.weight) == 1
    rng = np.random.default_rng(2)
    for k in range(1, 50):
        true = seen([0.4 - 0.8 * k * STEP, 0.1, 6.0], rng.normal(0, 0.9, 3), sd_deg=0.9)
        branches = branches.after(k * STEP, [true, mirrored(true)])
    sides = branches.course.centre[:, 0]
    assert (sides < 0).any()
    assert (sides > 0).any()


def test_a_course_that_is_no_number_ends():
    """Whatever a fit claims, choosing what is followed comes to an end."""
    lost = replace(seen([0.4, 0.1, 6.0]), position=np.full(3, np.nan))
    assert len(Branches.begin(0.0, [lost, lost]).weight) == 2


def test_what_was_missed_until_it_is_impossible_is_forgotten():
    branches = fly(branches_of(0.010, 0.020), [(0.010, 0.020)] * 40)
    assert (branches.weight[branches.missed] > -MOST_ODDS).all()


@pytest.mark.parametrize(("inliers", "lasting"), [(1.0, 1.0), (0.9, 0.9**-4), (0.8, CAUTION * 0.8**-4)])
def test_what_hides_points_of_images_in_a_row_is_doubted(inliers, lasting):
    assert lasting_doubt(seen((0.0, 0.0, 2.0), inliers=inliers)) == pytest.approx(lasting)


def test_a_fit_that_many_points_disagree_with_is_rather_missed_than_followed():
    course = fly(branches_of(0.01, 0.01, decided=True), [(0.010, 0.0101)] * 6)
    aside = [0.78 + 0.8, 0.0, 4.0]
    clean, hidden = (course.after(7 * STEP, [seen(aside, inliers=share)]) for share in (1.0, 0.7))
    odds = [after.weight[after.missed].max() - after.weight[~after.missed].max() for after in (clean, hidden)]
    assert odds[1] > odds[0] + 2.0


LONG_AGO = 40.0
"""Time for which a course was not joined [s]: beside an attitude nothing asks for it."""
WON = 0.3
"""Time of images in which fits that agree win against any course [s]."""


def hovered(rate_hz: float) -> Branches:
    """Two seconds over one place: a course that knows its velocity."""
    branches = Branches.begin(-2.0, [seen([0.0, 0.0, 2.0])])
    for k in range(1, int(2.0 * rate_hz)):
        branches = branches.after(-2.0 + k / rate_hz, [seen([0.0, 0.0, 2.0])])
    return branches


def stood(rate_hz: float) -> Branches:
    """A single image from close to the target: the course knows no velocity, 17 cm in the next image at 12 Hz."""
    return Branches.begin(-1.0 / rate_hz, [seen([0.0, 0.0, 0.12])])


def waited(rate_hz: float) -> Branches:
    """A course that no image joined for a long time."""
    before = hovered(rate_hz)
    return replace(before, course=replace(before.course, time=before.course.time - LONG_AGO))


def is_trusted(branches: Branches) -> bool:
    """What a pose is asked before it is published: decided, and where its course expects it."""
    is_near = branches.prior.mahalanobis2(branches.pose) <= LIMITS.certainty.deviations**2
    return branches.is_decided and not branches.missed[0] and is_near


@pytest.mark.parametrize("rate_hz", [15.0, 30.0])
@pytest.mark.parametrize("inliers", [1.0, 0.7])
@pytest.mark.parametrize(
    ("before", "start", "velocity"),
    [
        (stood, (0.0, 0.0, 0.12), (0.0, 0.0, 0.0)),
        (stood, (0.01, 0.0, 0.14), (0.1, 0.0, 0.8)),
        (hovered, (0.28, 0.0, 2.0), (0.0, 0.0, 0.0)),  # its attitude was off by 8 degrees
        (hovered, (0.1, 0.05, 2.0), (0.3, 0.2, 0.0)),
        (hovered, (0.9, -0.3, 1.6), (0.0, 0.5, -0.3)),
        (hovered, (0.0, 0.0, 4.0), (0.0, 0.0, 0.0)),
        (waited, (0.0, 0.0, 2.0), (0.0, 0.0, 0.0)),
        (waited, (0.3, 0.2, 1.5), (0.4, 0.0, 0.3)),
        (waited, (-1.0, 2.0, 3.0), (0.0, -0.5, 0.0)),
    ],
)
def test_fits_that_agree_win_against_any_course(before, start, velocity, inliers, rate_hz):
    rng = np.random.default_rng(7)
    branches, trusted = before(rate_hz), []
    for k in range(int(1.5 * rate_hz)):
        centre = np.add(start, np.multiply(velocity, k / rate_hz))
        shaken = np.radians(rng.normal(0.0, 0.3, 3))
        pose = seen(centre, rng.normal(0.0, 1.0, 3), inliers=inliers)
        branches = branches.after(k / rate_hz, [replace(pose, rotation=turn(pose.rotation, shaken))])
        trusted.append(is_trusted(branches))
    assert all(trusted[int(WON * rate_hz) :]), trusted


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("before", [hovered, waited])
def test_fits_that_do_not_agree_begin_no_course(before, seed):
    """Wrong fits lie anywhere within half of the range."""
    rng = np.random.default_rng(seed)
    branches, trusted = before(15.0), []
    for k in range(30):
        aside = rng.uniform(-1.0, 1.0, 3) * (1.0, 1.0, 0.2)
        branches = branches.after(k / 15.0, [seen(np.add([0.0, 0.0, 2.0], aside))])
        trusted.append(is_trusted(branches))
    assert not any(trusted[1:]), trusted

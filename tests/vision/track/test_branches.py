"""Inertia over a target: shaking is no motion, a mirrored pose is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.track.branches import (
    MOST_ODDS,
    Branches,
    Course,
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


@pytest.mark.parametrize(
    ("lead", "together", "is_against"), [(9.7, 4.1, True), (9.7, 1.5, False), (25.0, 7.5, False), (25.0, 8.5, True)]
)
def test_a_lead_has_to_outweigh_what_images_say_together(lead, together, is_against):
    """A poor fit threw the true course aside: its mirror image led by one jump, and was published 25 degrees off."""
    branches = branches_of(0.010, 0.010)
    branches = replace(branches, weight=np.array([0.0, -lead]), together=np.array([together, 0.0]))
    assert branches.is_decided
    assert branches.is_spoken_against is is_against


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


@pytest.mark.parametrize(
    ("before", "start", "velocity"),
    [
        (stood, (0.01, 0.0, 0.14), (0.1, 0.0, 0.8)),
        (hovered, (0.28, 0.0, 2.0), (0.0, 0.0, 0.0)),  # its attitude was off by 8 degrees
        (hovered, (0.9, -0.3, 1.6), (0.0, 0.5, -0.3)),
        (hovered, (0.0, 0.0, 4.0), (0.0, 0.0, 0.0)),
        (waited, (-1.0, 2.0, 3.0), (0.0, -0.5, 0.0)),
    ],
)
def test_fits_that_agree_win_against_any_course(before, start, velocity):
    rate_hz, rng = 15.0, np.random.default_rng(7)
    branches, trusted = before(rate_hz), []
    for k in range(int(1.5 * rate_hz)):
        centre = np.add(start, np.multiply(velocity, k / rate_hz))
        shaken = np.radians(rng.normal(0.0, 0.3, 3))
        pose = seen(centre, rng.normal(0.0, 1.0, 3), inliers=0.7)
        branches = branches.after(k / rate_hz, [replace(pose, rotation=turn(pose.rotation, shaken))])
        trusted.append(is_trusted(branches))
    assert all(trusted[int(WON * rate_hz) :]), trusted


@pytest.mark.parametrize("seed", range(2))
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

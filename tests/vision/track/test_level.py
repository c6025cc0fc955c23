"""The attitude and a target's tilt: decks that are learned, tilts that are held, attitudes that are left out."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.vision import TrackerSection
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import TargetLevel
from mkdaemon.vision.track.attitude import (
    AttitudeHistory,
    AttitudeSample,
    ImageSight,
    angle_of,
    fuse_normal,
    turn_between,
    without_normal,
)
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.judge import Judge
from mkdaemon.vision.track.level import LONGEST, PRIOR_SD, LevelKnowledge
from tests.vision.views import VGA, View, angle_deg, nearly, place, shipped

DOWN = LOOKING_DOWN.flu_from_cam.T
SHARP = np.radians(0.2)
AHEAD = np.eye(3)


PIXELS = np.zeros((2, 2), np.uint8)


class Deck:
    """What images taught of a deck and an attitude that is exact from image to image."""

    def __init__(self) -> None:
        self.level = LevelKnowledge(True, LOOKING_DOWN, TrackerSection(attitude_sd_deg=1e-6))

    def measured(self, time: float, enu_from_flu: np.ndarray, normal: np.ndarray, sd: float) -> None:
        """An image whose fit knows a normal `(3,)` [ENU] by a deviation of each axis [rad]."""
        seen = self._seen(time, enu_from_flu)
        level = seen.enu_from_cam.T
        rotation = turn(level, turn_between(level[:, 2], level @ normal / np.linalg.norm(normal)))
        spread = np.diag([1e-6] * 3 + [sd**2] * 3)
        self.level.learn(seen, Pose(rotation, np.array([0.0, 0.0, 1.0]), spread, "edges", 99, 0.1))

    def normal(self, time: float, enu_from_flu: np.ndarray) -> np.ndarray:
        """The normal expected `(3,)` [ENU]."""
        seen = self._seen(time, enu_from_flu)
        return seen.enu_from_cam @ self.level.vertical(seen).up

    def sd(self, time: float, enu_from_flu: np.ndarray) -> float:
        """Its deviation [rad]."""
        return self.level.vertical(self._seen(time, enu_from_flu)).spread

    def is_contradicted_at(self, time: float) -> bool:
        """Whether the attitude is left out of an image."""
        seen = self._seen(time, np.eye(3))
        return self.level.sight(seen) is not seen

    @staticmethod
    def _seen(time: float, enu_from_flu: np.ndarray) -> ImageSight:
        return ImageSight(PIXELS, time, enu_from_flu @ LOOKING_DOWN.flu_from_cam)


def pose_of(rotation: np.ndarray, angle_variance: float = 1e-6) -> Pose:
    return Pose(rotation, np.array([0.0, 0.0, 1.0]), np.diag([1e-6] * 3 + [angle_variance] * 3), "edges", 99, 0.1)


def knowledge() -> LevelKnowledge:
    return LevelKnowledge(True, LOOKING_DOWN, TrackerSection())


def tilt_of(level: LevelKnowledge, sight: ImageSight, pose: Pose) -> float:
    """Angle between the normal of a pose and the one expected [rad]."""
    return angle_of(pose.rotation[:, 2], level.vertical(sight).up)


def seen(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0, time: float = 0.0) -> ImageSight:
    return ImageSight(
        np.zeros((2, 2), np.uint8), time, rotation_from_euler(roll, pitch, yaw) @ LOOKING_DOWN.flu_from_cam
    )


def test_without_attitude_or_level_target_nothing_is_said() -> None:
    blind = ImageSight(np.zeros((2, 2), np.uint8), 0.0, None)
    slanted = LevelKnowledge(False, LOOKING_DOWN, TrackerSection())
    for level, sight in ((knowledge(), blind), (slanted, seen())):
        level.learn(sight, pose_of(DOWN))
        assert level.vertical(sight) is None


def test_an_expected_normal_moves_an_uncertain_tilt_and_leaves_a_certain_one() -> None:
    tilted = DOWN @ rotation_from_euler(np.radians(4.0), 0.0, 0.0)
    up = DOWN[:, 2]
    level = TargetLevel(up, np.radians(1.0))
    vague, sharp = pose_of(tilted, 0.01), pose_of(tilted, 1e-8)
    after = fuse_normal(vague, level)
    normal = after.rotation[:, 2]
    assert np.degrees(np.arccos(normal @ up)) < 0.3
    # Yaw, the turn about the normal, is not known any better.
    assert normal @ after.covariance[3:, 3:] @ normal == pytest.approx(0.01, rel=0.02)
    assert angle_deg(fuse_normal(sharp, level).rotation, tilted) < 0.01


def test_the_pose_of_the_image_alone_comes_back_where_it_says_more_than_the_fit_was_told() -> None:
    place = np.diag([1e-4, 1e-4, 1e-3, 1e-4, 2e-4, 1e-4])
    place[2, 3] = place[3, 2] = 2e-4
    image = replace(pose_of(DOWN @ rotation_from_euler(np.radians(1.0), np.radians(0.5), 0.4)), covariance=place)
    vague, sharp = (TargetLevel(DOWN[:, 2], spread) for spread in (0.03, 0.005))
    alone, says_more = without_normal(fuse_normal(image, vague), vague)
    assert says_more
    assert angle_deg(alone.rotation, image.rotation) < 0.02
    np.testing.assert_allclose(alone.position, image.position, atol=1e-4)
    np.testing.assert_allclose(alone.covariance, image.covariance, rtol=0.05, atol=1e-6)
    assert not without_normal(fuse_normal(image, sharp), sharp)[1]


def test_a_tilted_deck_is_learned_whatever_way_the_vehicle_faces() -> None:
    level, deck = knowledge(), rotation_from_euler(np.radians(4.0), np.radians(-3.0), 0.0)
    before = level.vertical(seen()).spread
    for k in range(30):
        sight = seen(0.1 * np.sin(k), 0.1 * np.cos(k), 0.3 * k, k / 30)
        found = pose_of(sight.enu_from_cam.T @ deck, 1e-5)
        level.learn(sight, found)
    last = seen(0.05, 0.0, 2.0, 1.0)
    found = pose_of(last.enu_from_cam.T @ deck)
    assert np.degrees(tilt_of(level, last, found)) < 0.3
    assert level.vertical(last).spread < before
    assert np.degrees(tilt_of(level, last, pose_of(DOWN))) > 3.0


def show_normal(deck: Deck, begin: float, end: float, normal: tuple[float, float], sd: float) -> None:
    """Show a deck that leans by so much, 30 times a second."""
    for k in range(round(30 * begin), round(30 * end)):
        deck.measured(k / 30, AHEAD, np.array([*normal, 1.0]), sd)


def test_what_is_known_of_a_deck_fades_to_the_prior() -> None:
    deck = Deck()
    assert deck.sd(0.0, AHEAD) == pytest.approx(PRIOR_SD)
    show_normal(deck, 0.0, 20 / 30, (0.05, 0.0), SHARP)
    assert deck.sd(20 / 30, AHEAD) < min(0.3 * PRIOR_SD, deck.sd(1.0, AHEAD))
    assert deck.sd(1.0, AHEAD) < deck.sd(1.5, AHEAD) < deck.sd(9.0, AHEAD) == pytest.approx(PRIOR_SD)
    deck.measured(1.0 + LONGEST, AHEAD, np.array([0.0, 0.0, 1.0]), SHARP)
    np.testing.assert_allclose(deck.normal(1.0 + LONGEST, AHEAD), [0.0, 0.0, 1.0], atol=1e-6)


def turning(time: float, apart: float, rate: float = 0.4, count: int = 9):
    """What attitudes so far apart [s] say of the turning at a time."""
    return AttitudeHistory(AttitudeSample(k * apart, rate * k * apart, 0.0, 0.0) for k in range(count)).turning_at(time)


def test_the_turning_comes_from_the_attitudes_around_an_image() -> None:
    assert turning(0.03, 0.02, count=5).rate == pytest.approx([0.4, 0.0, 0.0], abs=1e-6)
    assert turning(0.2, 0.02, count=5) is None
    assert turning(0.0, 0.02, count=0) is None
    assert turning(0.15, 0.1, 1.0, 5) is None, "distant attitudes say nothing about what lies between"


RIGHT, WRONG = radians(1.0), radians(12.0)
STEP = 1 / 30
FEWEST = 3
"""Images that contradict which leave the attitude out: what lies over a target misleads neighbouring images alike."""
SEEN = radians(1.2)


def tell(
    deck: Deck, time: float, east: float, north: float = 0.0, yaw: float = 0.0, *, of_vehicle: bool = False
) -> bool:
    """An image in which the target's normal leans by so much; returns whether the attitude is left out."""
    enu_from_flu = rotation_from_euler(0.0, 0.0, yaw)
    lean = np.array([east, north, 0.0])
    lean = enu_from_flu @ lean if of_vehicle else lean
    deck.measured(time, enu_from_flu, np.array([*lean[:2], np.sqrt(1.0 - lean @ lean)]), SEEN)
    return deck.is_contradicted_at(time)


def shown(deck: Deck, offs: list[float], start: float = 0.0) -> float:
    """Show images in which the attitude is off by so much; returns the time of the next one."""
    for k, off in enumerate(offs):
        tell(deck, start + k * STEP, off)
    return start + len(offs) * STEP


@pytest.mark.parametrize("known", [0, 100])
def test_a_lasting_contradiction_is_told_with_its_angle(known: int) -> None:
    deck = Deck()
    start = shown(deck, [RIGHT] * known)
    told = [tell(deck, start + k * STEP, WRONG) for k in range(10)]
    assert told == [k >= FEWEST - 1 for k in range(10)]
    assert round(deck.level.contradicted_deg) == pytest.approx(12, abs=1)


@pytest.mark.parametrize("seed", range(3))
def test_contradictions_that_do_not_agree_accuse_nobody(seed: int) -> None:
    """A vibration behind a rolling shutter turns the normal another way in every image."""
    rng, deck = np.random.default_rng([seed, 0x517]), Deck()
    wobble = rng.normal(0.0, WRONG / 2, (75, 2))
    assert np.count_nonzero(np.linalg.norm(wobble, axis=1) > radians(5.0)) > 4 * FEWEST
    assert not any(tell(deck, k * STEP, *off) for k, off in enumerate(wobble))


@pytest.mark.parametrize("of_vehicle", [False, True])
def test_contradictions_that_agree_in_the_world_or_on_the_vehicle_leave_it_out(of_vehicle: bool) -> None:
    """A deck stays while the vehicle yaws by half a turn, a mounting turns with it."""
    deck = Deck()
    told = [tell(deck, k * STEP, WRONG, yaw=np.pi * k / 10, of_vehicle=of_vehicle) for k in range(10)]
    assert told[-1]


def test_the_attitude_is_taken_up_again_after_it_agreed_and_left_out_again_as_soon() -> None:
    deck, now = Deck(), 0.0
    for _ in range(3):
        now = shown(deck, [WRONG] * 30, now)
        assert deck.is_contradicted_at(now)
        assert tell(deck, now, RIGHT)
        now = shown(deck, [RIGHT] * 30, now + STEP)
        assert not deck.is_contradicted_at(now)


def test_without_images_that_tell_the_attitude_is_tried_again_as_after_a_clock_that_is_set_back() -> None:
    deck = Deck()
    now = shown(deck, [WRONG] * FEWEST)
    assert deck.is_contradicted_at(now + LONGEST / 2)
    assert not deck.is_contradicted_at(now + LONGEST)
    shown(deck, [WRONG] * FEWEST, 100.0)
    assert not deck.is_contradicted_at(1.0)
    assert not tell(deck, 1.0, RIGHT)


KNOWN = 30
"""Images that told the tilt."""


def judge_of(name: str) -> Judge:
    """Judge of a target over a level place."""
    fitter = TargetFitter(shipped(name), Projection(VGA))
    return Judge(fitter, LevelKnowledge(True, LOOKING_DOWN, TrackerSection()), TrackerSection())


def test_what_the_image_cannot_tell_inertia_does() -> None:
    """A tilt held to an attitude that jumps by 6 degrees was published once in some thousand images after the jump."""
    view, judge = View(shipped("nested"), place(3.8, 0.25)), judge_of("nested")
    right = Pose(view.rotation, view.position, 1e-6 * np.eye(6), "edges", 200, 0.05, loss=1.0)
    leaning = replace(right, rotation=turn(view.rotation, np.radians([6.0, 0.0, 0.0])))
    seen = ImageSight(view.pixels, KNOWN / 30)
    assert not judge.prefers(seen, right, leaning, None)
    before = Branches.begin(0.0, [right])
    for k in range(1, KNOWN):
        before = before.after(k / 30, [right])
    assert judge.prefers(seen, right, leaning, before)
    assert not judge.prefers(seen, leaning, right, before)


@pytest.mark.parametrize(("name", "distance", "off_deg"), [("single", 3.0, 0.8), ("nested", 3.5, 0.0)])
def test_a_tilt_that_a_fit_is_told_counts_as_much_as_it_is_known(name: str, distance: float, off_deg: float) -> None:
    """A fit that is told a normal ends where a free one ends that hears of it afterwards, and is as certain."""
    view = View(shipped(name), place(distance, 0.5))
    spread = np.radians(0.6)
    up = turn(view.rotation, np.radians([off_deg, 0.0, 0.0]))[:, 2]
    fit = EdgeFit(shipped(name), Projection(VGA))
    free, told = fit.fit(view.pixels, nearly(view)), fit.fit(view.pixels, nearly(view), level=TargetLevel(up, spread))
    assert free is not None
    fused = fuse_normal(free, TargetLevel(up, spread))
    assert np.linalg.norm(told.position - fused.position) < 0.6 * np.sqrt(np.trace(fused.covariance[:3, :3]))
    assert angle_deg(told.rotation, fused.rotation) < 0.6 * np.degrees(np.sqrt(np.trace(fused.covariance[3:, 3:])))
    assert np.trace(told.covariance[3:, 3:]) > 0.5 * np.trace(fused.covariance[3:, 3:])

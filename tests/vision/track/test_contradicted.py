"""An attitude that contradicts the images is left out, and taken up again once it agrees."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN, VGA
from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mkdaemon.vision.track.level import LONGEST
from mkdaemon.vision.track.tracker import Tracker
from tests.vision.track.decks import Deck
from tests.vision.views import View, place, shipped

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


def test_single_contradictions_leave_the_attitude_in_use() -> None:
    deck = Deck()
    for k, off in enumerate([WRONG, *[RIGHT] * 5] * 20):
        assert not tell(deck, k * STEP, off)


@pytest.mark.parametrize("known", [0, 100])
def test_a_lasting_contradiction_is_told_with_its_angle(known: int) -> None:
    deck = Deck()
    start = shown(deck, [RIGHT] * known)
    told = [tell(deck, start + k * STEP, WRONG) for k in range(10)]
    assert told == [k >= FEWEST - 1 for k in range(10)]
    assert round(deck.level.contradicted_deg) == pytest.approx(12, abs=1)


@pytest.mark.parametrize("seed", range(10))
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


def test_a_swapped_sign_that_passes_level_stays_left_out() -> None:
    """Where the vehicle is level for a moment a swapped sign agrees with everything."""
    deck = Deck()
    told = [tell(deck, k * STEP, WRONG * np.cos(2 * np.pi * k / 60)) for k in range(240)]
    assert all(told[FEWEST - 1 :])


def test_the_attitude_is_taken_up_again_after_it_agreed_and_left_out_again_as_soon() -> None:
    deck, now = Deck(), 0.0
    for _ in range(3):
        now = shown(deck, [WRONG] * 30, now)
        assert deck.is_contradicted_at(now)
        assert tell(deck, now, RIGHT)
        now = shown(deck, [RIGHT] * 30, now + STEP)
        assert not deck.is_contradicted_at(now)


def test_without_images_that_tell_the_attitude_is_tried_again() -> None:
    deck = Deck()
    now = shown(deck, [WRONG] * FEWEST)
    assert deck.is_contradicted_at(now + LONGEST / 2)
    assert not deck.is_contradicted_at(now + LONGEST)


def test_a_clock_that_is_set_back_begins_anew() -> None:
    deck = Deck()
    shown(deck, [WRONG] * FEWEST, 100.0)
    assert not deck.is_contradicted_at(1.0)
    assert not tell(deck, 1.0, RIGHT)


def test_the_tracker_poses_by_the_images_alone_while_the_attitude_is_wrong_and_comes_back() -> None:
    target = shipped("nested")
    tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
    view = View(target, place(2.0, 0.3))
    right = euler_from_rotation(view.view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T)
    posed = []
    for k in range(45):
        rpy = (-right[0], -right[1], right[2]) if k < 15 else right
        time = k * 0.1
        noisy = np.roll(view.pixels, k % 2, axis=1)  # images that repeat count as frozen
        image = CameraImage(noisy, time, time, k, "down")
        result = tracker.update(image, AttitudeHistory([AttitudeSample(time, *rpy)]))
        posed.append(bool(result.poses))
        assert k >= 15 or posed[k] == (tracker.contradicted_deg is not None)
        if k == 14:
            assert tracker.contradicted_deg is not None
            assert np.degrees(0.5) < tracker.contradicted_deg < np.degrees(0.7)
    assert not posed[0]
    assert all(posed[FEWEST - 1 :])
    assert tracker.contradicted_deg is None


def test_a_level_target_far_from_level_contradicts_the_attitude_however_slowly_it_got_there() -> None:
    """A swapped sign grows with the angle: learned as a deck that moves, it would be followed to any tilt."""
    target = shipped("nested")
    tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
    left_out = []
    view = View(target, place(2.0, 0.3))
    right = euler_from_rotation(view.view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T)
    for k in range(60):
        time = k * STEP
        noisy = np.roll(view.pixels, k % 2, axis=1)
        off = radians(15.0) * k / 60
        reported = AttitudeHistory([AttitudeSample(time, right[0] + off, right[1], right[2])])
        assert len(tracker.update(CameraImage(noisy, time, time, k, "down"), reported).poses) <= 1
        left_out.append(tracker.contradicted_deg is not None)
    assert not any(left_out[:30])
    assert left_out[-1]

"""An attitude that contradicts the images is left out, and taken up again once it agrees."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from lab.vision.flight import VGA
from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import LOOKING_DOWN, AttitudeHistory, AttitudeSample
from mkdaemon.vision.track.tracker import Tracker
from mkdaemon.vision.track.witness import BACK_AFTER, FEWEST, FORGET, LOOKS, AttitudeWitness
from tests.vision.views import View, place, shipped

RIGHT, WRONG, GATE = radians(1.0), radians(12.0), radians(5.0)
STEP = 1 / 30


def tell(witness: AttitudeWitness, time: float, off: float) -> bool:
    """An image in which the attitude's roll is off by so much; the vehicle's nose points east."""
    return witness.image_seen(time, np.array([off, 0.0, 0.0]), np.eye(3), GATE)


def shown(witness: AttitudeWitness, offs: list[float], start: float = 0.0) -> float:
    """Show images in which the attitude is off by so much; returns the time of the next one."""
    for k, off in enumerate(offs):
        tell(witness, start + k * STEP, off)
    return start + len(offs) * STEP


def is_left_out(witness: AttitudeWitness) -> bool:
    return witness.contradicts


def test_single_contradictions_leave_the_attitude_in_use() -> None:
    witness = AttitudeWitness()
    shown(witness, [WRONG, *[RIGHT] * (LOOKS // 2)] * 20)
    assert not witness.contradicts


def test_contradictions_far_apart_leave_the_attitude_in_use() -> None:
    witness = AttitudeWitness()
    for k in range(FEWEST + 1):
        tell(witness, 1.5 * k, WRONG)
    assert not witness.contradicts


def test_a_lasting_contradiction_is_told_once_with_its_angle() -> None:
    witness = AttitudeWitness()
    told = [tell(witness, k * STEP, WRONG) for k in range(LOOKS)]
    assert told == [k == FEWEST - 1 for k in range(LOOKS)]
    assert witness.contradicts
    assert round(witness.off_deg) == 12


@pytest.mark.parametrize("seed", range(10))
def test_contradictions_that_do_not_agree_accuse_nobody(seed: int) -> None:
    """A vibration behind a rolling shutter turns the normal another way in every image."""
    rng, witness = np.random.default_rng([seed, 0x517]), AttitudeWitness()
    wobble = np.pad(rng.normal(0.0, WRONG / 2, (75, 2)), ((0, 0), (0, 1)))
    assert np.count_nonzero(np.linalg.norm(wobble, axis=1) > GATE) > 4 * FEWEST
    assert not any(witness.image_seen(k * STEP, off, np.eye(3), GATE) for k, off in enumerate(wobble))


@pytest.mark.parametrize("of_vehicle", [False, True])
def test_contradictions_that_agree_in_the_world_or_on_the_vehicle_leave_it_out(of_vehicle: bool) -> None:
    """A deck stays while the vehicle yaws by half a turn, a mounting turns with it."""
    witness = AttitudeWitness()
    for k in range(LOOKS):
        enu_from_flu = rotation_from_euler(0.0, 0.0, np.pi * k / LOOKS)
        off = np.array([WRONG, 0.0, 0.0])
        witness.image_seen(k * STEP, enu_from_flu @ off if of_vehicle else off, enu_from_flu, GATE)
    assert witness.contradicts


def test_the_attitude_is_taken_up_again_after_it_agreed_and_later_each_time() -> None:
    witness, now = AttitudeWitness(), 0.0
    waited = []
    for _ in range(3):
        now = shown(witness, [WRONG] * FEWEST, now)
        start = now
        while is_left_out(witness):
            now = shown(witness, [RIGHT], now)
        waited.append(now - start)
    np.testing.assert_allclose(waited, BACK_AFTER[0] * np.array([1, 2, 4]), atol=2.5 * STEP)


def test_one_contradiction_starts_the_wait_anew() -> None:
    witness = AttitudeWitness()
    now = shown(witness, [WRONG] * FEWEST)
    most = int(BACK_AFTER[0] / STEP) - 2
    shown(witness, [*[RIGHT] * most, WRONG, *[RIGHT] * most], now)
    assert witness.contradicts


def test_without_images_that_tell_the_attitude_is_tried_again() -> None:
    witness = AttitudeWitness()
    now = shown(witness, [WRONG] * FEWEST)
    witness.time_passed(now + FORGET / 2)
    assert witness.contradicts
    witness.time_passed(now + FORGET)
    assert not witness.contradicts


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
        if k == 14:
            assert tracker.witness.contradicts
            assert np.degrees(0.5) < tracker.witness.off_deg < np.degrees(0.7)
    assert not any(posed[: FEWEST - 1])
    assert all(posed[FEWEST - 1 :])
    assert not tracker.witness.contradicts


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
        tracker.update(CameraImage(noisy, time, time, k, "down"), reported)
        left_out.append(tracker.witness.contradicts)
    assert not any(left_out[:30])
    assert left_out[-1]

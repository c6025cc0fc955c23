"""Several tags are one pose, and what the model of a print looks like."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, inverse, turn
from mkdaemon.vision.pose.prints import Prints, roots
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import TagMap, Target, build
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import Cover, LightConditions
from tests.places import CONFIGS
from tests.vision.views import VGA, PlainView, View, asphalt, place, shipped

Array = npt.NDArray[np.float64]
PROJECTION = Projection(VGA)


def laid_out(*places: tuple[float, float], size: float = 0.12) -> Target:
    """Tags on one floor."""
    tags = tuple(TagPlacement(id=10 + k, size=size, position=(x, y, 0.0)) for k, (x, y) in enumerate(places))
    return build([TargetSection(name="deck", tags=tags)], origin="test").targets[0]


DECK = laid_out((-0.4, -0.3), (0.4, -0.3), (0.4, 0.3), (-0.4, 0.3))
SINGLES = [Target(f"tag{k}", f"tag{k}", False, True, (tag,)) for k, tag in enumerate(DECK.tags)]


def shoot(distance: float, tilt: float, around: float, *covers: Cover) -> View:
    """An image of the deck."""
    seen = place(distance, tilt, around, roll=around)
    return PlainView(DECK, seen, LightConditions(covers=covers), 5, asphalt())


def track(pixels: npt.NDArray[np.uint8], *targets: Target) -> list[Pose]:
    """What a fresh tracker publishes without attitude."""
    found = Tracker(TagMap(targets), VGA).update(CameraImage(pixels, 0.0, 0.0, 0, "test", "driver"))
    return [each.pose for each in found.poses]


def off(pose: Pose, view: View) -> tuple[Array, Array]:
    """Error of the camera's place and attitude in the target's axes `(6,)`, and its covariance."""
    _, camera, covariance = inverse(pose, pose.covariance)
    turned = np.asarray(cv2.Rodrigues(pose.rotation.T @ view.rotation)[0], np.float64).ravel()
    return np.concatenate([camera + view.rotation.T @ view.position, turned]), covariance


def off_m(pose: Pose, view: View) -> float:
    """Error of the camera's place in the target's axes [m]."""
    return float(np.linalg.norm(off(pose, view)[0][:3]))


def test_a_tag_inside_another_is_of_its_print_and_one_beside_it_is_a_print() -> None:
    assert [tag.tag_id for tag in roots(shipped("nested"))] == [48]
    assert [tag.tag_id for tag in roots(shipped("landing"))] == [46]
    assert len(roots(DECK)) == 4


def measured(target: Target, view: View) -> Pose:
    """The pose of a fit that starts half a cell and half a degree beside the truth."""
    beside = Pose(turn(view.rotation, np.full(3, 0.005)), view.position + 0.003, np.eye(6), "corners", 4, 0.1)
    return TargetFitter(target, PROJECTION).refine(view.pixels, beside)


def test_a_joint_fit_is_the_information_of_all_tags() -> None:
    joint_errors, single_errors, deviations = [], [], []
    for distance, tilt, around in ((2.4, 0.1, 0.4), (2.6, 0.4, 2.0)):
        view = shoot(distance, tilt, around)
        joint = measured(DECK, view)
        assert joint.source == "photometric"
        error, covariance = off(joint, view)
        singles = [off(measured(tag, view), view) for tag in SINGLES]
        joint_errors.append(float(np.linalg.norm(error[:3])))
        single_errors.append(min(float(np.linalg.norm(each[:3])) for each, _ in singles))
        fused = np.linalg.inv(sum(np.linalg.inv(each) for _, each in singles))
        deviations.append(np.sqrt(np.trace(covariance[:3, :3]) / np.trace(fused[:3, :3])))
        assert float(error @ np.linalg.solve(covariance, error)) < 22.5  # chi-square(6), 1 in 1000
    # The share that an image may be longer by one way is one for all tags, and no sum of theirs.
    assert deviations == pytest.approx([1.0] * 2, rel=0.55)
    assert np.mean(joint_errors) < 0.4 * np.mean(single_errors)
    assert max(joint_errors) < 1e-3


def test_tags_far_away_that_are_too_uncertain_alone_are_posed_together() -> None:
    view = shoot(4.65, 0.3, 1.0)
    assert track(view.pixels, *SINGLES) == []
    (joint,) = track(view.pixels, DECK)
    assert off_m(joint, view) < 5e-3


@pytest.mark.parametrize(
    ("hidden", "beside", "half", "seen"),
    [(0, 0.0, 0.1, (2.5, 0.2, 0.7)), (3, 0.02, 0.051, (4.8, 0.23, 1.94))],
)
def test_a_tag_that_is_hidden_in_part_leads_no_fit_astray(hidden: int, beside: float, half: float, seen) -> None:
    x, y, _ = DECK.tags[hidden].position
    corners = tuple((x + beside + half * i, y + half * j) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    view = shoot(*seen, Cover(corners))
    found = track(view.pixels, DECK)
    assert found or not beside
    assert all(off_m(pose, view) < 5e-3 for pose in found)


CAMERA = load_camera(CONFIGS / "cameras" / "sim.toml")
ABOVE = np.diag([1.0, -1.0, -1.0])
STRAIGHT = CAMERA.intrinsics.model_copy(update={"k1": 0.0, "k2": 0.0})


@pytest.mark.parametrize("streak_px", [0.0, 3.0, 10.0])
@pytest.mark.parametrize("way", [0.3, 1.2])
def test_what_a_growing_point_spread_changes(streak_px: float, way: float) -> None:
    """A streak grows by its ends: taken for a Gaussian its derivative has half the size and nothing of the form."""
    model = Prints(shipped("single"), Projection(STRAIGHT)).all[0]
    rotation, position = turn(ABOVE, np.array([0.2, 0.1, 0.0])), np.array([0.013, 0.021, 4.5])
    along = np.array([np.cos(way), np.sin(way)])
    spread = 0.36 * np.eye(2) + streak_px**2 / 12.0 * np.outer(along, along)
    black = np.zeros((480, 640), dtype=np.uint8)
    here = model.samples(black, rotation, position, spread)
    ways = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
    for more, slope in zip(0.1 * ways, here.by_spread, strict=True):
        wider, narrower = (model.samples(black, rotation, position, spread + sign * more) for sign in (1.0, -1.0))
        found = (wider.value - narrower.value) / 0.2
        assert np.std(found - slope) < 0.25 * np.std(found)


def test_a_print_whose_plane_goes_through_the_camera_is_not_seen() -> None:
    target = shipped("single")
    model = Prints(target, Projection(STRAIGHT)).all[0]
    rotation = turn(np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 0.6]))
    for axes in (rotation, rotation @ turn(np.eye(3), np.array([0.0, 0.0, 0.4]))):
        position = 3.0 * axes[:, 0] + 3.0 * axes[:, 1]
        position *= np.sign(position[2]) or 1.0
        assert model.samples(np.zeros((480, 640), dtype=np.uint8), axes, position, 0.4 * np.eye(2)) is None

"""Several tags beside each other are one pose: fitted together, they know what no single one of them knows."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, inverse, turn
from mkdaemon.vision.pose.prints import MOST, Prints, roots
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import TagMap, Target, build
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import Cover, LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from tests.vision.views import VGA, asphalt, place, shipped

Array = npt.NDArray[np.float64]
PROJECTION = Projection(VGA)


def laid_out(*places: tuple[float, float], size: float = 0.12) -> Target:
    """Tags on one floor."""
    tags = tuple(TagPlacement(id=10 + k, size=size, position=(x, y, 0.0)) for k, (x, y) in enumerate(places))
    return build([TargetSection(name="deck", tags=tags)], origin="test").targets[0]


DECK = laid_out((-0.4, -0.3), (0.4, -0.3), (0.4, 0.3), (-0.4, 0.3))
SINGLES = [Target(f"tag{k}", f"tag{k}", False, True, (tag,)) for k, tag in enumerate(DECK.tags)]


@lru_cache
def studio() -> tuple[Scene, SceneTarget]:
    placed = SceneTarget.of(DECK, Platform())
    return Scene([placed], ground=asphalt(), seed=5, fine=False), placed


def shoot(distance: float, tilt: float, around: float, *covers: Cover) -> tuple[npt.NDArray[np.uint8], Array, Array]:
    """An image of the deck, with its rotation and position in the camera."""
    scene, placed = studio()
    view = place(distance, tilt, around, roll=around)
    rotation, position = cam_from_target(placed, view)
    return scene.render(view, LightConditions(covers=covers)), rotation, position


def track(pixels: npt.NDArray[np.uint8], *targets: Target) -> list[Pose]:
    """What a fresh tracker publishes without attitude."""
    found = Tracker(TagMap(targets), VGA).update(CameraImage(pixels, 0.0, 0.0, 0, "test", "driver"))
    return [each.pose for each in found.poses]


def off(pose: Pose, rotation: Array, position: Array) -> tuple[Array, Array]:
    """Error of the camera's place and attitude in the target's axes `(6,)`, and its covariance."""
    _, camera, covariance = inverse(pose, pose.covariance)
    turned = np.asarray(cv2.Rodrigues(pose.rotation.T @ rotation)[0], np.float64).ravel()
    return np.concatenate([camera + rotation.T @ position, turned]), covariance


def test_a_tag_inside_another_is_of_its_print_and_one_beside_it_is_a_print() -> None:
    assert [tag.tag_id for tag in roots(shipped("nested"))] == [48]
    assert [tag.tag_id for tag in roots(shipped("landing"))] == [46]
    assert len(roots(DECK)) == 4


def measured(target: Target, pixels: npt.NDArray[np.uint8], rotation: Array, position: Array) -> Pose:
    """The pose of a fit that starts half a cell and half a degree beside the truth."""
    beside = Pose(turn(rotation, np.full(3, 0.005)), position + 0.003, np.eye(6), "corners", 4, 0.1)
    found = TargetFitter(target, PROJECTION).refine(pixels, beside)
    assert found is not None
    return found


def test_a_joint_fit_is_the_information_of_all_tags() -> None:
    joint_errors, single_errors, deviations = [], [], []
    for distance, tilt, around in ((2.4, 0.1, 0.4), (2.6, 0.4, 2.0)):
        pixels, rotation, position = shoot(distance, tilt, around)
        joint = measured(DECK, pixels, rotation, position)
        assert joint.source == "photometric"
        error, covariance = off(joint, rotation, position)
        singles = [off(measured(tag, pixels, rotation, position), rotation, position) for tag in SINGLES]
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
    pixels, rotation, position = shoot(4.65, 0.3, 1.0)
    assert track(pixels, *SINGLES) == []
    (joint,) = track(pixels, DECK)
    assert float(np.linalg.norm(off(joint, rotation, position)[0][:3])) < 5e-3


@pytest.mark.parametrize("hidden", range(4))
def test_a_hidden_tag_leads_no_fit_astray(hidden: int) -> None:
    x, y, _ = DECK.tags[hidden].position
    corners = tuple((x + 0.1 * i, y + 0.1 * j) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    pixels, rotation, position = shoot(2.5, 0.2, 0.7, Cover(corners))
    for pose in track(pixels, DECK):
        assert float(np.linalg.norm(off(pose, rotation, position)[0][:3])) < 5e-3


def test_a_far_tag_that_is_hidden_in_part_leads_no_fit_astray() -> None:
    x, y, _ = DECK.tags[3].position
    corners = tuple((x + 0.02 + 0.051 * i, y + 0.051 * j) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    pixels, rotation, position = shoot(4.8, 0.23, 1.94, Cover(corners))
    (pose,) = track(pixels, DECK)
    assert float(np.linalg.norm(off(pose, rotation, position)[0][:3])) < 5e-3


def test_a_tag_in_the_image_decides_how_a_map_is_measured_not_its_origin() -> None:
    floor = laid_out((6.0, 0.0), (6.6, 0.0))
    prints = Prints(floor, PROJECTION)
    rotation = np.diag([1.0, -1.0, -1.0])
    pose = Pose(rotation, -rotation @ np.array([6.3, 0.0, 1.3]), np.eye(6), "edges", 100, 0.1)
    assert pose.tilt > LIMITS.cells.edges_up_to
    assert prints.looked_at(pose)[2] == pytest.approx(np.arctan(0.3 / 1.3))
    assert prints.cell_px(pose) == pytest.approx(600 * 0.012 / 1.3 * 10 / 8, rel=0.3)
    beside = Pose(rotation, -rotation @ np.array([9.0, 0.0, 1.3]), np.eye(6), "edges", 100, 0.1)
    assert prints.seen(beside.rotation, beside.position) == ()
    assert prints.looked_at(beside)[2] == pytest.approx(np.arctan(3.0 / 1.3))
    many = Prints(laid_out(*((0.2 * x, 0.2 * y) for x in range(3) for y in range(3))), PROJECTION)
    assert len(many.seen(rotation, -rotation @ np.array([0.2, 0.2, 2.0]))) == MOST < 9


def test_a_start_from_one_far_tag_ends_where_all_of_them_are() -> None:
    pixels, rotation, position = shoot(4.65, 0.3, 1.0)
    fitter, middle = TargetFitter(DECK, PROJECTION), DECK.tags[0].position
    wrong = turn(rotation, np.radians(np.array([4.0, -3.0, 2.0])))  # the other tags are up to 9 px beside their place
    start = Pose(wrong, rotation @ middle + position - wrong @ middle, np.eye(6), "corners", 4, 0.1)
    found = fitter.refine(pixels, start)
    assert found is not None
    assert float(np.linalg.norm(off(found, rotation, position)[0][:3])) < 5e-3


@pytest.mark.parametrize("shown", [(0,), ()])
def test_prints_that_are_not_in_the_image_move_no_start(shown: tuple[int, ...]) -> None:
    pixels, rotation, position = shoot(2.5, 0.2, 0.7)
    prints = Prints(DECK, PROJECTION)
    for k, tag in enumerate(DECK.tags):
        middle = PROJECTION.project((tag.position @ rotation.T + position)[None])[0][0].astype(int)
        if k not in shown:
            cv2.circle(pixels, tuple(int(each) for each in middle), 32, (90,), -1)
    beside = Pose(turn(rotation, np.full(3, 0.03)), position, np.eye(6), "corners", 4, 0.1)
    assert prints.gathered(pixels, beside) is beside

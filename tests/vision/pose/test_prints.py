"""Several tags are one pose, and what the model of a print looks like."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, inverse, turn
from mkdaemon.vision.pose.prints import MOST, MOST_PLACES, Footprint, Prints, roots
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
    view, middle = shoot(4.65, 0.3, 1.0), DECK.tags[0].position
    wrong = turn(view.rotation, np.radians(np.array([4.0, -3.0, 2.0])))  # the other tags are up to 9 px off
    start = Pose(wrong, view.rotation @ middle + view.position - wrong @ middle, np.eye(6), "corners", 4, 0.1)
    assert off_m(TargetFitter(DECK, PROJECTION).refine(view.pixels, start), view) < 5e-3


@pytest.mark.parametrize("shown", [(0,), ()])
def test_prints_that_are_not_in_the_image_move_no_start(shown: tuple[int, ...]) -> None:
    view, prints = shoot(2.5, 0.2, 0.7), Prints(DECK, PROJECTION)
    for k, tag in enumerate(DECK.tags):
        middle = PROJECTION.project((tag.position @ view.rotation.T + view.position)[None])[0][0].astype(int)
        if k not in shown:
            cv2.circle(view.pixels, tuple(int(each) for each in middle), 32, (90,), -1)
    beside = Pose(turn(view.rotation, np.full(3, 0.03)), view.position, np.eye(6), "corners", 4, 0.1)
    assert prints.gathered(view.pixels, beside) is beside


CAMERA = load_camera(CONFIGS / "cameras" / "sim.toml")
ABOVE = np.diag([1.0, -1.0, -1.0])
STRAIGHT = CAMERA.intrinsics.model_copy(update={"k1": 0.0, "k2": 0.0})
BLUR_PX = 0.6
PARTS = 24
"""Sub-samples of a pixel, each way, of a drawing that is taken for exact."""
ALONG_ROWS = [(10.6, 0.6), (6.1, 0.5)]
"""Distance [m] and tilt about the rows of the image [rad]: edges lie along rows, and all of each is drawn alike."""


def white_of(target: Target, distance: float) -> float:
    """White in the image of a print, seen from above [m^2]."""
    projection = Projection(CAMERA.intrinsics)
    model = Prints(target, projection).all[0]
    pixels = np.zeros((480, 640), dtype=np.uint8)
    seen = model.samples(pixels, ABOVE, np.array([0.01, 0.02, distance]), 0.2 * np.eye(2))
    return float(seen.value.sum() * (distance / projection.focal[0]) ** 2)


@pytest.mark.parametrize("distance", [5.0, 8.0])
def test_an_inner_tag_has_as_much_white_from_afar_as_its_cells(distance: float) -> None:
    target = shipped("nested")
    outer, inner = target.tags
    cells = np.pad(inner.bitmap, 1, constant_values=255) / 255
    # The inner tag lies on black cells.
    added = white_of(target, distance) - white_of(replace(target, tags=(outer,)), distance)
    assert added == pytest.approx(inner.module**2 * cells.sum(), rel=0.02)


def drawn(target: Target, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """White of the single tag in every pixel of the image `(480, 640)`, the lens's blur before the pixels see it."""
    tag, lens = target.tags[0], STRAIGHT
    cells = np.pad((tag.bitmap > 0).astype(np.float32), 2, constant_values=1.0)
    middle = position[:2] / position[2] * lens.fx + (lens.cx, lens.cy)
    left, top = (int(v) - 24 for v in middle)
    at = (np.arange(48 * PARTS) + 0.5) / PARTS - 0.5
    ray_x, ray_y = (at + left - lens.cx) / lens.fx, (at + top - lens.cy)[:, None] / lens.fy
    to_plane = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], position]))
    x, y, w = (row[0] * ray_x + row[1] * ray_y + row[2] for row in to_plane)
    n = len(cells)
    column = np.clip(np.floor(x / w / tag.module + n / 2).astype(int), 0, n - 1)
    row = np.clip(np.floor(n / 2 - y / w / tag.module).astype(int), 0, n - 1)
    sharp = cells[row, column]
    soft = cv2.GaussianBlur(sharp, (0, 0), BLUR_PX * PARTS)
    image = np.ones((lens.height, lens.width))
    image[top : top + 48, left : left + 48] = soft.reshape(48, PARTS, 48, PARTS).mean(axis=(1, 3))
    return image


@pytest.mark.parametrize(("distance", "tilt"), ALONG_ROWS)
def test_an_edge_along_a_row_of_pixels_is_drawn_in_its_place_and_the_range_of_its_tag_is_right(distance, tilt) -> None:
    target = shipped("single")
    rotation, position = turn(ABOVE, np.array([tilt, 0.0, 0.0])), np.array([0.013, 0.021, distance])
    model, exact = Prints(target, Projection(STRAIGHT)).all[0], drawn(target, rotation, position)
    seen = model.samples(np.zeros((480, 640), dtype=np.uint8), rotation, position, BLUR_PX**2 * np.eye(2))
    height, width = seen.used.shape
    exactly = exact[seen.top : seen.top + height, seen.left : seen.left + width][seen.used]
    assert float(np.abs(seen.value - exactly).max()) < 0.016
    image = np.rint(10.0 + 160.0 * exact).astype(np.uint8)
    start = Pose(rotation, position, np.eye(6), "corners", 4, 0.0)
    found = TargetFitter(target, Projection(STRAIGHT)).refine(image, start)
    assert found.source == "photometric"
    assert abs(found.range_m - float(np.linalg.norm(position))) < 0.001 * distance


@pytest.mark.parametrize("slant", [1.5, 1.57079])
@pytest.mark.parametrize("spread", [np.diag([0.4, 0.4]), np.diag([100.0, 0.3]), np.array([[40.0, 39.0], [39.0, 40.0]])])
def test_a_print_seen_from_its_edge_is_looked_up_at_few_places(slant: float, spread: np.ndarray) -> None:
    for distance in (0.8, 2.0, 5.0):
        rotation, position = turn(ABOVE, np.array([slant, 0.0, 0.0])), np.array([0.0, 0.3, distance])
        plane = np.array([[1.0, 0.0], [0.0, 1.0 / np.cos(slant)]]) * distance / STRAIGHT.fx
        assert Footprint.of(spread, plane).places.shape[1] <= MOST_PLACES
        model = Prints(shipped("nested"), Projection(STRAIGHT)).all[0]
        seen = model.samples(np.zeros((480, 640), dtype=np.uint8), rotation, position, spread)
        assert seen is None or np.isfinite(seen.value).all()


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

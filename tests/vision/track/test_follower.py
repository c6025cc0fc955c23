"""Following one target: what it may take of an image's time, and maps from tag to tag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import TrackerSection, VisionSection
from mkdaemon.frames import euler_from_rotation, rotation_from_euler, rotation_from_quaternion
from mkdaemon.telemetry.vision import CameraSetup, VisionPose
from mkdaemon.vision.camera.calibration_file import mount_rotation
from mkdaemon.vision.camera.camera import StreamStatus
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Place, Tag, TagMap, Target, single
from mkdaemon.vision.tags.targetfile import load
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, Mounting
from mkdaemon.vision.track.follower import MOST_EFFORT, Follower
from mkdaemon.vision.track.mapfollower import MapFollower
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.camera import BUILT_IN
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView
from tests.places import CONFIGS
from tests.vision.views import VGA, View, place, shipped


def test_a_target_that_is_gone_costs_an_image_a_bounded_number_of_fits():
    view, tracker = View(shipped("single"), place(2.0, 0.2)), Tracker(TagMap((shipped("single"),)), VGA, LOOKING_DOWN)
    (follower,) = tracker.followers
    gone = np.roll(view.pixels, 60, axis=1)[::-1].copy()
    for k in range(5):
        pixels = (view.pixels if k < 2 else gone).copy()
        pixels[0, 0] ^= k & 1  # equal images would be those of a frozen camera
        found = tracker.update(CameraImage(pixels, k / 30, k / 30, k, "down")).poses
        assert bool(found) is (k < 2)
        # of the start that spends the last of it every fit is made
        assert k < 2 or follower._fitter.effort <= 2 * MOST_EFFORT


LENS = BUILT_IN.intrinsics
FAMILY = find_family("tag36h11")
DOWN = np.diag([1.0, -1.0, -1.0])
FLU_FROM_CAM = mount_rotation(BUILT_IN.mount)
HEIGHT, SPEED, FPS = 1.6, 1.5, 15.0
PAD = Place("pad-b", np.array([2.4, 0.0, 0.0]), rotation_from_euler(0.0, 0.0, 0.5))


def corridor(*, sd: float = 0.0) -> Target:
    """Ten tags 0.6 m apart in two rows; the last is the pad."""
    tags = []
    for code in range(10):
        place, turn = np.array([0.6 * (code // 2), 0.5 * (code % 2), 0.0]), rotation_from_euler(0.0, 0.0, 0.7 * code)
        tags.append(Tag(FAMILY, code, 0.2, place, turn, np.full(3, sd), np.full(3, sd)))
    return Target("room", "room", moving=False, level=True, tags=tuple(tags), places=(PAD,))


def test_only_sparse_targets_of_many_tags_are_maps(tmp_path):
    shipped = [target for file in (CONFIGS / "targets").glob("*.toml") for target in load([file]).targets]
    board = "[[targets]]\nname = 'wall'\n[targets.board]\nfirst_id = 0\nrows = 6\ncolumns = 6\nsize = 0.05\n"
    (tmp_path / "board.toml").write_text(board + "spacing = 0.02\n")
    for target in [*shipped, *load([tmp_path / "board.toml"]).targets, single(0.2, 3)]:
        assert not target.is_map
    assert type(Tracker(TagMap((target,)), LENS).followers[0]) is Follower
    assert corridor().is_map


def views(count: int):
    """A camera that flies along the corridor, and the attitude of its vehicle."""
    for k in range(count):
        time = k / FPS
        turn = rotation_from_euler(0.05 * np.sin(3.0 * time), 0.04 * np.cos(2.0 * time), 0.1 * time) @ DOWN
        yield time, np.array([SPEED * time, 0.2, HEIGHT]), turn


def attitude_at(time: float, turn) -> AttitudeHistory:
    angles = euler_from_rotation(turn @ FLU_FROM_CAM.T)
    return AttitudeHistory(tuple(AttitudeSample(time + late, *angles) for late in (-0.02, 0.02)))


@pytest.fixture(scope="module")
def flown() -> list[tuple[np.ndarray, list]]:
    """Where the camera was, and what was published, along the whole corridor."""
    target = corridor()
    scene = Scene([SceneTarget.of(target, Platform())], ground="asphalt", seed=1, fine=False, live=True)
    clock = Clock(monotonic=lambda: 0.0, wall=lambda: 0.0, synchronised=lambda: True, suspended=lambda: 0.0)
    pipeline = CameraPipeline(
        CameraSection(name="down", source="simulated"),
        VisionSection(),
        clock,
        camera=BUILT_IN,
        tagmap=TagMap((target,)),
    )
    found = []
    for k, (time, at, turn) in enumerate(views(16)):
        pixels = scene.render(CameraView(LENS, turn, at, exposure_time=0.003))
        values = pipeline.process(CameraImage(pixels, time, time, k, "down", "header"), attitude_at(time, turn))
        found.append((at, [value for _, value in values if isinstance(value, VisionPose)]))
    found.append((at, pipeline.report(StreamStatus("ok", "", fps=FPS, width=640, height=480), clock.stamp())))
    return found


def test_a_map_is_posed_from_tag_to_tag(flown):
    *images, _ = flown
    posed = [(place, value) for place, values in images for value in values if value.target == "room"]
    assert len(posed) == len(images)
    assert {value.mode for _, value in posed[1:]} <= {"predicted", "flow"}, "nothing is searched for on the way"
    off = np.array([np.subtract(value.position_target, place) for place, value in posed])
    assert np.abs(off).max() < 0.015
    said = [np.array(value.covariance).reshape(6, 6)[:3, :3] for _, value in posed]
    assert np.mean([e @ np.linalg.solve(c, e) / 3.0 for e, c in zip(off, said, strict=True)]) < 1.5
    assert max(np.sqrt(np.trace(c)) for c in said) < 0.02, "as certain at the far end as at the origin"


def test_a_place_is_a_target_in_its_own_frame(flown):
    *images, (_, report) = flown
    for _, (of_map, of_place) in images:
        assert (of_map.target, of_place.target) == ("room", "pad-b")
        assert of_map.is_of_map
        assert of_place.is_of_map
        expected = PAD.rotation.T @ (np.array(of_map.position_target) - PAD.position)
        assert of_place.position_target == pytest.approx(expected)
        turned = PAD.rotation.T @ rotation_from_quaternion(of_map.quaternion_target_from_flu)
        assert rotation_from_quaternion(of_place.quaternion_target_from_flu) == pytest.approx(turned)
        a, b = (np.array(one.covariance).reshape(6, 6)[:3, :3] for one in (of_map, of_place))
        assert b == pytest.approx(PAD.rotation.T @ a @ PAD.rotation, abs=1e-9)
    [setup] = [value for _, value in report if isinstance(value, CameraSetup)]
    room, pad = setup.targets
    assert (room.name, pad.name, len(pad.tags)) == ("room", "pad-b", 10)
    for one, other in zip(room.tags, pad.tags, strict=True):
        assert other.corners == pytest.approx((np.array(one.corners) - PAD.position) @ PAD.rotation, abs=1e-9)


def test_what_a_survey_leaves_open_makes_a_pose_less_certain():
    place, turn = np.array([1.2, 0.2, HEIGHT]), rotation_from_euler(0.03, 0.02, 0.0) @ DOWN
    scene = Scene([SceneTarget.of(corridor(), Platform())], ground="asphalt", seed=1, fine=False, live=True)
    pixels = scene.render(CameraView(LENS, turn, place))
    found = {}
    for sd in (0.0, 0.01):
        tracker = Tracker(TagMap((corridor(sd=sd),)), LENS, Mounting(FLU_FROM_CAM, np.zeros(3)))
        [pose] = tracker.update(CameraImage(pixels, 0.0, 0.0, 0, "down", "header"), attitude_at(0.0, turn)).poses
        found[sd] = pose.camera_in_target()[2][:3, :3]
    more = np.diag(found[0.01] - found[0.0])
    # The place, and the turn at the arm of the height.
    assert more[:2] == pytest.approx(0.01**2 * (1.0 + HEIGHT**2), rel=0.15)
    assert more[2] == pytest.approx(0.01**2, rel=0.15)


def test_a_print_that_faces_away_is_not_chosen():
    whole = corridor()
    wall = replace(whole.tags[0], rotation=rotation_from_euler(np.pi, 0.0, 0.0))
    target = replace(whole, tags=(wall, *whole.tags[1:]))
    follower = MapFollower(
        target, Projection(LENS), Detector({"tag36h11": frozenset(range(10))}), None, TrackerSection()
    )
    above = Pose(DOWN, np.array([0.0, 0.0, HEIGHT]), np.eye(6), "edges", 40, 0.3)
    assert [tag.tag_id for tag in follower._prints[follower._best(above)].tags] != [0]

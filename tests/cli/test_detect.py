"""`mkdaemon detect` on rendered images with known truth, in folders and videos."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import single
from mkdaemon.vision.tags.targetfile import load
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target, true_corners
from mksim.scene.view import view_towards
from tests.places import CONFIGS

TARGET = CONFIGS / "targets" / "nested.toml"
LENS = Intrinsics(width=640, height=480, fx=600, fy=602, cx=322, cy=238, k1=-0.2, k2=0.05)
SHORT = "600,602,322,238,-0.2,0.05"


@pytest.fixture
def detect(typed):
    """Runs the command: exit code, JSON objects and error text."""

    def call(*words):
        code, out, err = typed(app, "detect", *words)
        return code, [json.loads(line) for line in out.splitlines()] if "--json" in words else [], err

    return call


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for name, pad in PADS.items():
        cv2.imwrite(str(folder / f"{name}.png"), Scene([pad], ground="tiles", seed=3).render(VIEW))
    return folder


VIEW = view_towards(LENS, np.array([0.2, -0.5, 0.9]), np.array([0.03, 0.02, 0.0]), turn=0.7)
PADS = {
    "nested": SceneTarget.of(load([TARGET]).targets[0], Platform()),
    "single": SceneTarget.of(single(0.2, 7), Platform(heading=2.5)),
}


def assert_pose(found: dict, pad: SceneTarget) -> None:
    rotation, translation = cam_from_target(pad, VIEW)
    np.testing.assert_allclose(found["translation"], translation, atol=0.003)
    turned = rotation_from_quaternion(tuple(found["quaternion"])).T @ rotation
    assert np.degrees(np.arccos(min((np.trace(turned) - 1) / 2, 1.0))) < 0.3
    covariance = np.array(found["covariance"])
    assert covariance.shape == (6, 6)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert not found["ambiguous"]


def test_a_target_of_the_map_is_found_where_it_is(pictures, detect):
    words = (pictures / "nested.png", "--target", TARGET, "--intrinsics", SHORT, "--json")
    code, (found,), _ = detect(*words)
    assert code == EXIT_OK
    assert found["file"].endswith("nested.png")
    assert {tag["id"] for tag in found["tags"]} == {48, 1}
    for tag in found["tags"]:
        truth = true_corners(PADS["nested"], VIEW)["tag36h11", tag["id"]]
        np.testing.assert_allclose(tag["corners"], truth, atol=0.4)  # straight lines through curved edges
        assert tag["hamming"] <= 2
    assert_pose(found["pose"], PADS["nested"])


def test_single_tags_have_their_own_poses(pictures, detect):
    words = (pictures / "single.png", "--tag-size", 0.2, "--intrinsics", SHORT, "--json")
    _, (found,), _ = detect(*words)
    (tag,) = found["tags"]
    assert tag["id"] == 7
    np.testing.assert_allclose(tag["corners"], true_corners(PADS["single"], VIEW)["tag36h11", 7], atol=0.4)
    assert_pose(tag["pose"], PADS["single"])
    assert found["pose"] == tag["pose"] == found["poses"][0]


def test_a_calibration_of_another_size_gives_an_error_and_no_pose(pictures, detect):
    small = cv2.imread(str(pictures / "single.png"))[:400]
    cv2.imwrite(str(pictures / "small.png"), small)
    camera = CONFIGS / "cameras" / "sim.toml"
    code, (found,), _ = detect(pictures / "small.png", "--tag-size", 0.2, "--camera", camera, "--json")
    (pictures / "small.png").unlink()
    assert code == EXIT_FAILURE
    assert found["pose"] is None
    assert found["error"] == "the picture is 640x400, the calibration is for 640x480"


def test_a_folder_gives_one_object_a_picture_and_overlays(pictures, tmp_path, detect):
    (pictures / "broken.png").write_bytes(b"\x89PNG nothing")
    words = (pictures, "--tag-size", 0.2, "--intrinsics", SHORT, "--overlay", tmp_path / "over", "--json")
    code, found, _ = detect(*words)
    (pictures / "broken.png").unlink()
    assert code == EXIT_FAILURE
    assert [Path(item["file"]).name for item in found] == ["broken.png", "nested.png", "single.png"]
    assert "error" in found[0]
    drawn = cv2.imread(str(tmp_path / "over" / "single.png"))
    plain = cv2.imread(str(pictures / "single.png"))
    changed = np.abs(drawn.astype(int) - plain).max(axis=2) > 40
    rows, columns = np.nonzero(changed)
    low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
    truth = true_corners(PADS["single"], VIEW)["tag36h11", 7]
    assert (low <= truth.min(axis=0) + 3).all()
    assert (high >= truth.max(axis=0) - 3).all()
    assert (high - low < 2.2 * np.ptp(truth, axis=0)).all()


def test_a_video_gives_one_object_an_image(tmp_path, detect):
    clip = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (640, 480), isColor=False)
    for k in range(3):
        view = view_towards(LENS, np.array([0.1 * k, -0.3, 0.9]), np.zeros(3))
        writer.write(Scene([PADS["single"]], ground=None, seed=k).render(view))
    writer.release()
    code, found, _ = detect(clip, "--tag-size", 0.2, "--ids", "5-9", "--intrinsics", SHORT, "--json")
    assert code == EXIT_OK
    assert [item["frame"] for item in found] == [0, 1, 2]
    assert all(item["pose"]["target"] == "tag36h11:7" for item in found)

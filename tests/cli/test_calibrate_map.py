"""`mkdaemon calibrate map` from rendered pictures and a recording: files, names of what is left out, mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.frames import rotation_from_euler, rotation_from_quaternion
from mkdaemon.vision.camera.calibration_file import Camera, save_camera
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Tag, Target
from mkdaemon.vision.tags.targetfile import load
from mksim.scene.camera import BUILT_IN
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView
from tests.places import DATA

RECORDINGS = DATA / "recordings"
LENS = BUILT_IN.intrinsics
PLACES = {3: (0.0, 0.0), 4: (0.5, 0.02), 8: (-0.03, 0.45), 9: (0.48, 0.5)}
SMALL = 8
"""Another side than was said."""


def room() -> Target:
    family = find_family("tag36h11")
    tags = [
        Tag(family, code, 0.12 if code == SMALL else 0.16, np.array([x, y, 0.0]), rotation_from_euler(0.0, 0.0, code))
        for code, (x, y) in PLACES.items()
    ]
    return Target("room", "room", moving=False, level=True, tags=tuple(tags))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pictures of the four tags, from as many places."""
    folder = tmp_path_factory.mktemp("pictures")
    scene = Scene([SceneTarget.of(room(), Platform())], ground="asphalt", seed=3, fine=False)
    for k in range(8):
        lean = 0.25 * np.array([np.cos(k), np.sin(k)])
        turned = rotation_from_euler(lean[0], lean[1], 0.8 * k) @ np.diag([1.0, -1.0, -1.0])
        place = np.array([0.25, 0.25, 0.0]) - 1.2 / turned[2, 2] * -turned[:, 2]
        cv2.imwrite(str(folder / f"{k}.png"), scene.render(CameraView(LENS, turned, place)))
    (folder / "broken.png").write_bytes(b"broken")
    return folder


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    save_camera(Camera(intrinsics=LENS), tmp_path / "camera.toml")
    return tmp_path / "camera.toml"


def survey(*words: object) -> int:
    return run(app, ["calibrate", "map", *(str(word) for word in words)])


def test_pictures_become_a_target_file(pictures: Path, camera: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, drawn = camera.with_name("map.toml"), camera.with_name("map.svg")
    words = (pictures, "--camera", camera, "--size", 0.16, "--sizes", f"{SMALL}=0.12", "--origin", 3)
    words += ("--place", "pad=9")
    assert survey(*words, "-o", file, "--picture", drawn, "--json") == EXIT_OK
    found = json.loads(capsys.readouterr().out)
    assert (found["images"], found["left_out"]) == (8, [])
    [target] = load([file]).targets
    places = {tag.tag_id: tag.position for tag in target.tags}
    turn = rotation_from_euler(0.0, 0.0, -3.0)
    for code, (x, y) in PLACES.items():
        assert places[code] == pytest.approx(turn @ (x, y, 0.0), abs=0.002)
    deviations = {one["id"]: one["position_sd"] for one in found["tags"]}
    assert {tag.tag_id: tag.place_sd.tolist() for tag in target.tags} == {
        code: pytest.approx(sd, abs=1e-5) for code, sd in deviations.items()
    }
    [pad] = target.places
    assert (pad.name, pad.position.tolist()) == ("pad", places[9].tolist())
    assert "Surveyed by 8 images" in file.read_text()
    assert drawn.read_text().startswith("<svg")
    assert survey(*words, "-o", file) == EXIT_CONFIG, "it is there already"
    capsys.readouterr()
    assert (
        run(app, ["detect", str(pictures / "0.png"), "--camera", str(camera), "--target", str(file), "--json"])
        == EXIT_OK
    )
    pose = json.loads(capsys.readouterr().out)["pose"]
    middle = turn @ (0.25, 0.25, 0.0)
    seen = rotation_from_quaternion(tuple(pose["quaternion"])) @ middle + pose["translation"]
    assert seen == pytest.approx([0.0, 0.0, 1.2 / np.cos(0.25)], abs=0.005), (
        "the camera looks at the middle of the four"
    )


def test_a_tag_of_another_side_is_named(pictures: Path, camera: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = camera.with_name("map.json")
    code = survey(pictures, "--camera", camera, "--size", 0.16, "-o", file, "--format", "wpilib")
    assert code == EXIT_FAILURE
    output = capsys.readouterr().out
    assert f"left out: tag {SMALL} (wrong_side): its side is 0.1200 m" in output
    assert "this format holds neither sizes nor family" in output
    assert {tag["ID"] for tag in json.loads(file.read_text())["tags"]} == PLACES.keys() - {SMALL}

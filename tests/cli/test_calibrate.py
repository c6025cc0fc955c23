"""`mkdaemon calibrate`: camera, map and mount from rendered pictures and flights, prints; poor ones are refused."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.config.camera import MountSection
from mkdaemon.frames import rotation_from_euler, rotation_from_quaternion
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.telemetry.vision import VisionStats
from mkdaemon.vision.calibrate.board import CharucoBoard
from mkdaemon.vision.calibrate.views import Views
from mkdaemon.vision.camera.calibration_file import Camera, Intrinsics, load_camera, save_camera
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Tag, Target
from mkdaemon.vision.tags.targetfile import load
from mksim.scene.camera import BUILT_IN
from mksim.scene.layers import board_layer
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView
from tests.client.fake import CLOCK, VEHICLE, fake_daemon, in_background
from tests.places import CONFIGS
from tests.values import made
from tests.vision.calibrate.boardviews import LENS, PLACES, board_views

BOARD = CharucoBoard(9, 6, 0.03)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    layer = board_layer(BOARD.cells, 0.27, 0.18)
    for k, image in enumerate(board_views((layer,), 0.27)):
        cv2.imwrite(str(folder / f"view{k}.png"), image)
    (folder / "view99.png").write_bytes(b"broken")
    return folder


def calibrate(*words: object) -> int:
    return run(app, ["calibrate", "camera", *(str(word) for word in words)])


def test_a_folder_becomes_a_camera_file(pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "camera.toml"
    code = calibrate(pictures, "-o", file, "--lens", "2.8 mm", "--looks", "forward", "--mount", 0.1, 0, -0.05, "--json")
    summary = json.loads(capsys.readouterr().out)
    assert code == EXIT_OK
    assert summary["faults"] == summary["missing"] == []
    camera = load_camera(file)
    assert camera.intrinsics.fx == pytest.approx(LENS.fx, rel=0.002)
    assert camera.calibration.views == len(PLACES)
    assert camera.calibration.lens == "2.8 mm"
    assert camera.mount.position_flu == (0.1, 0.0, -0.05)
    assert not camera.calibration.forced


def test_a_poor_calibration_is_refused_unless_forced(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = tmp_path / "few"
    few.mkdir()
    layer = board_layer(BOARD.cells, 0.27, 0.18)
    places = tuple((0.5, 0.5, 1.3 + 0.02 * k, 3, 0, 15 * k) for k in range(6))
    for k, image in enumerate(board_views((layer,), 0.27, places=places)):
        cv2.imwrite(str(few / f"{k}.png"), image)
    file = tmp_path / "poor.toml"
    assert calibrate(few, "-o", file) == EXIT_FAILURE
    assert not file.exists()
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "calibration refused" in error
    assert calibrate(few, "-o", file, "--accept-poor") == EXIT_OK
    assert load_camera(file).calibration.forced


def test_pictures_of_two_sizes_are_named(pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = cv2.imread(str(pictures / "view0.png"))
    cv2.imwrite(str(tmp_path / "a.png"), image)
    cv2.imwrite(str(tmp_path / "b.png"), image[:400])
    assert calibrate(tmp_path) == EXIT_FAILURE
    assert "b.png is 640x400, a.png is 640x480" in capsys.readouterr().err


def test_live_views_are_taken_when_still_and_new(pictures: Path, tmp_path: Path) -> None:
    views = Views(BOARD, keep=tmp_path / "kept")
    reasons = []
    for k in (0, 0, 0, 1, 1):
        image = cv2.imread(str(pictures / f"view{k}.png"), cv2.IMREAD_GRAYSCALE)
        report = views.take(f"view{k}", image, is_live=True)
        reasons.append("taken" if report.is_taken else report.words)
    assert reasons == ["hold still", "taken", "move on", "hold still", "taken"]
    assert len(list((tmp_path / "kept").iterdir())) == 2


def test_a_clip_is_a_live_camera(pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"FFV1"), 200.0, (640, 480), isColor=False)
    for k in range(len(PLACES)):
        for _ in range(2):
            writer.write(cv2.imread(str(pictures / f"view{k}.png"), cv2.IMREAD_GRAYSCALE))
    writer.release()
    file = tmp_path / "live.toml"
    assert calibrate("--source", f"file:{clip}", "-o", file) == EXIT_OK
    shown = capsys.readouterr().out
    assert "Next: show the board in the" in shown
    assert load_camera(file).intrinsics.fx == pytest.approx(LENS.fx, rel=0.003)


BUILT_IN_LENS = BUILT_IN.intrinsics
TAG_PLACES = {3: (0.0, 0.0), 4: (0.5, 0.02), 8: (-0.03, 0.45), 9: (0.48, 0.5)}
SMALL = 8
"""Another side than was said."""


def room() -> Target:
    family = find_family("tag36h11")
    tags = [
        Tag(family, code, 0.12 if code == SMALL else 0.16, np.array([x, y, 0.0]), rotation_from_euler(0.0, 0.0, code))
        for code, (x, y) in TAG_PLACES.items()
    ]
    return Target("room", "room", moving=False, level=True, tags=tuple(tags))


@pytest.fixture(scope="module")
def tag_pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pictures of the four tags, from as many places."""
    folder = tmp_path_factory.mktemp("tag_pictures")
    scene = Scene([SceneTarget.of(room(), Platform())], ground="asphalt", seed=3, fine=False)
    for k in range(8):
        lean = 0.25 * np.array([np.cos(k), np.sin(k)])
        turned = rotation_from_euler(lean[0], lean[1], 0.8 * k) @ np.diag([1.0, -1.0, -1.0])
        place = np.array([0.25, 0.25, 0.0]) - 1.2 / turned[2, 2] * -turned[:, 2]
        cv2.imwrite(str(folder / f"{k}.png"), scene.render(CameraView(BUILT_IN_LENS, turned, place)))
    (folder / "broken.png").write_bytes(b"broken")
    return folder


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    save_camera(Camera(intrinsics=BUILT_IN_LENS), tmp_path / "camera.toml")
    return tmp_path / "camera.toml"


def survey(*words: object) -> int:
    return run(app, ["calibrate", "map", *(str(word) for word in words)])


def test_pictures_become_a_target_file(tag_pictures: Path, camera: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, drawn = camera.with_name("map.toml"), camera.with_name("map.svg")
    words = (tag_pictures, "--camera", camera, "--size", 0.16, "--sizes", f"{SMALL}=0.12", "--origin", 3)
    words += ("--place", "pad=9")
    assert survey(*words, "-o", file, "--picture", drawn, "--json") == EXIT_OK
    found = json.loads(capsys.readouterr().out)
    assert (found["images"], found["left_out"]) == (8, [])
    [target] = load([file]).targets
    places = {tag.tag_id: tag.position for tag in target.tags}
    turn = rotation_from_euler(0.0, 0.0, -3.0)
    for code, (x, y) in TAG_PLACES.items():
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
        run(app, ["detect", str(tag_pictures / "0.png"), "--camera", str(camera), "--target", str(file), "--json"])
        == EXIT_OK
    )
    pose = json.loads(capsys.readouterr().out)["pose"]
    middle = turn @ (0.25, 0.25, 0.0)
    seen = rotation_from_quaternion(tuple(pose["quaternion"])) @ middle + pose["translation"]
    assert seen == pytest.approx([0.0, 0.0, 1.2 / np.cos(0.25)], abs=0.005), (
        "the camera looks at the middle of the four"
    )


def test_a_tag_of_another_side_is_named(tag_pictures: Path, camera: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = camera.with_name("map.json")
    code = survey(tag_pictures, "--camera", camera, "--size", 0.16, "-o", file, "--format", "wpilib")
    assert code == EXIT_FAILURE
    output = capsys.readouterr().out
    assert f"left out: tag {SMALL} (wrong_side): its side is 0.1200 m" in output
    assert "this format holds neither sizes nor family" in output
    assert {tag["ID"] for tag in json.loads(file.read_text())["tags"]} == TAG_PLACES.keys() - {SMALL}


MOUNTED = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
ESTIMATE = made(
    SelfCalibration, target="pad", looks=90, mounting_deg=(2.9, -1.0, 0.2), mounting_sd_deg=(0.2, 0.2, 1.3),
    mount_believed_deg=(1.0, 0.0, 0.0), mount_rpy_deg=(3.9, -1.0, 0.0),
)  # fmt: skip
VAGUE = ESTIMATE.model_copy(update={"target": "deck", "mounting_sd_deg": (2.2, 2.2, 5.0)})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "camera.toml"
    save_camera(Camera(intrinsics=MOUNTED, mount=MountSection(rpy_deg=(1.0, 0.0, 0.0), looks="down")), path)
    return path


@asynccontextmanager
async def flown(**cameras: list[SelfCalibration]) -> AsyncIterator[list[str]]:
    """A daemon whose cameras tell this; yields where it is."""
    async with fake_daemon() as daemon:
        for name, estimates in cameras.items():
            stats = made(VisionStats, CLOCK.stamp(), camera=name, selfcal=tuple(estimates))
            daemon.bus.publish(f"vision/{name}/stats", stats)
        yield ["--vehicle", VEHICLE, "--connect", daemon.endpoint]


def mount(*words: object) -> int:
    return run(app, ["calibrate", "mount", *(str(word) for word in words)])


def test_both_are_shown_and_nothing_is_written(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = file.read_bytes()
    with in_background(flown(down=[VAGUE, ESTIMATE])) as at:
        assert mount(file, *at) == EXIT_OK
    out = capsys.readouterr().out
    assert "mount.rpy_deg  file 1.00, 0.00, 0.00  flight 3.90, -1.00, 0.00" in out
    assert "nothing written" in out
    assert file.read_bytes() == before


def test_it_is_stored_when_asked(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with in_background(flown(down=[ESTIMATE], front=[VAGUE])) as at:
        assert mount(file, *at, "--camera", "down", "--store", "--json") == EXIT_OK
    assert json.loads(capsys.readouterr().out)["stored"] is True
    after = load_camera(file)
    assert after.mount == MountSection(rpy_deg=(3.9, -1.0, 0.0))
    assert after.intrinsics == MOUNTED


@pytest.mark.parametrize(
    ("cameras", "code", "words"),
    [
        ({}, EXIT_FAILURE, "no camera reports"),
        ({"down": [ESTIMATE], "front": [ESTIMATE]}, EXIT_FAILURE, "cameras down, front: give one with --camera"),
        ({"down": []}, EXIT_FAILURE, "fly over one first"),
        ({"down": [VAGUE]}, EXIT_FAILURE, "known to 2.2 deg after 90 images, 0.5 is needed: turn (yaw)"),
        (
            {"down": [ESTIMATE.model_copy(update={"mount_believed_deg": (0.0, 0.0, 0.0)})]},
            EXIT_CONFIG,
            "mount.rpy_deg 1.00, 0.00, 0.00, the daemon flies with 0.00, 0.00, 0.00",
        ),
    ],
    ids=["no camera", "two cameras", "no target", "no yaw", "another file"],
)
def test_what_is_not_known_is_not_stored(
    file: Path, capsys: pytest.CaptureFixture[str], cameras: dict[str, list[SelfCalibration]], code: int, words: str
) -> None:
    before = file.read_bytes()
    with in_background(flown(**cameras)) as at:
        assert mount(file, *at, "--store") == code
    assert words in capsys.readouterr().err
    assert file.read_bytes() == before


def target(*words: object) -> int:
    return run(app, ["calibrate", "print", *(str(word) for word in words)])


@pytest.mark.parametrize(
    ("words", "width"),
    [
        (("--target", CONFIGS / "targets" / "nested.toml"), 304.8 * 10 / 8 + 26),
        (("--tag", "7:0.16"), 160 * 10 / 8 + 26),
        (("--tag", "tag25h9/3:0.14"), 140 * 9 / 7 + 26),
        (("--charuco", "9x6", "--square", "0.03"), 270 + 26),
    ],
)
@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_every_kind_is_printed_in_its_size(
    words: tuple[object, ...], width: float, suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert target(tmp_path / f"x.{suffix}", *words, "--json") == EXIT_OK
    told = json.loads(capsys.readouterr().out)
    assert told["width_mm"] == pytest.approx(width, abs=0.01)
    assert Path(told["file"]).stat().st_size > 1000

"""`mkdaemon calibrate camera` from rendered pictures: a file, poor ones refused, mistakes in one line."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK, run
from mkdaemon.vision.calibrate.board import CharucoBoard
from mkdaemon.vision.calibrate.views import Views
from mkdaemon.vision.camera.calibration_file import load_camera
from mksim.scene.layers import board_layer
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

"""The line time from the bands of a flickering lamp, into the camera file; refused where there are none."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.errors import VisionError
from mkdaemon.vision.calibrate.calibration import line_time_of
from mkdaemon.vision.camera.calibration_file import Camera, Intrinsics, load_camera, save_camera

WIDTH, HEIGHT = 80, 240


def wall(line_time: float, flicker: float = 0.15, images: int = 12) -> list[np.ndarray]:
    """A wall that is brighter at its foot, under a lamp of 100 Hz."""
    rng = np.random.default_rng(3)
    rows = np.arange(HEIGHT)
    found = []
    for phase in rng.uniform(0.0, 2 * np.pi, images):
        lamp = 1.0 + flicker * np.cos(2 * np.pi * 100.0 * line_time * rows + phase)
        light = (90.0 + 0.2 * rows) * lamp
        found.append((light[:, None] + 2.0 * rng.standard_normal((HEIGHT, WIDTH))).clip(0, 255).astype(np.uint8))
    return found


@pytest.mark.parametrize("readout", [0.018, 0.03, 0.05])
def test_the_line_time_is_found_within_its_deviation(readout: float) -> None:
    found, sd = line_time_of(wall(readout / HEIGHT), 100.0)
    assert found == pytest.approx(readout / HEIGHT, abs=max(2 * sd, 0.01 * readout / HEIGHT))


def test_no_bands_are_no_line_time() -> None:
    with pytest.raises(VisionError, match="no bands"):
        line_time_of(wall(1e-4, flicker=0.0), 100.0)
    with pytest.raises(VisionError, match="at least 8"):
        line_time_of(wall(1e-4, images=3), 100.0)


def shutter(*words: object) -> int:
    return run(app, ["calibrate", "shutter", *(str(word) for word in words)])


def test_it_goes_into_the_camera_file_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, pictures = tmp_path / "camera.toml", tmp_path / "wall"
    pictures.mkdir()
    for k, image in enumerate(wall(0.03 / HEIGHT)):
        cv2.imwrite(str(pictures / f"{k:02d}.png"), image)
    lens = Intrinsics(width=WIDTH, height=HEIGHT, fx=80.0, fy=80.0, cx=40.0, cy=120.0)
    save_camera(Camera(intrinsics=lens), file)
    assert shutter(file, pictures) == EXIT_OK
    assert "nothing written" in capsys.readouterr().out
    assert load_camera(file).intrinsics == lens
    assert shutter(file, pictures, "--store", "--json") == EXIT_OK
    assert json.loads(capsys.readouterr().out)["stored"] is True
    assert load_camera(file).intrinsics.line_time == pytest.approx(0.03 / HEIGHT, rel=0.01)
    assert shutter(file, pictures, "--mains", "60") == EXIT_OK
    other = lens.model_copy(update={"width": 100})
    save_camera(Camera(intrinsics=other), file, overwrite=True)
    assert shutter(file, pictures) == EXIT_CONFIG
    assert "another size" in capsys.readouterr().err


def test_a_readout_that_no_camera_has_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "camera.toml"
    for k, image in enumerate(wall(0.09 / HEIGHT)):
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), image)
    save_camera(Camera(intrinsics=Intrinsics(width=WIDTH, height=HEIGHT, fx=80.0, fy=80.0, cx=40.0, cy=120.0)), file)
    assert shutter(file, tmp_path) == EXIT_FAILURE
    assert "something else moves" in capsys.readouterr().err

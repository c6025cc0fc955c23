"""Line time and tone curve of a camera, measured from pictures; nothing stored that is not known."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.errors import VisionError
from mkdaemon.vision.calibrate.board import edge_levels
from mkdaemon.vision.calibrate.calibration import line_time_of, tone_curve
from mkdaemon.vision.camera.calibration_file import Camera, Intrinsics, load_camera, save_camera
from mkdaemon.vision.camera.image import in_light

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


LENS = Intrinsics(width=WIDTH, height=HEIGHT, fx=80.0, fy=80.0, cx=40.0, cy=120.0)


def shutter(*words: object) -> int:
    return run(app, ["calibrate", "shutter", *(str(word) for word in words)])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    save_camera(Camera(intrinsics=LENS), tmp_path / "camera.toml")
    return tmp_path / "camera.toml"


def pictures(folder: Path, readout: float) -> Path:
    """Pictures of the wall by a camera that reads its rows out in so long [s]."""
    (folder / "wall").mkdir()
    for k, image in enumerate(wall(readout / HEIGHT)):
        cv2.imwrite(str(folder / "wall" / f"{k:02d}.png"), image)
    return folder / "wall"


def test_it_goes_into_the_camera_file_when_asked(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = pictures(file.parent, 0.03)
    assert shutter(file, shown) == EXIT_OK
    assert "nothing written" in capsys.readouterr().out
    assert load_camera(file).intrinsics == LENS
    assert shutter(file, shown, "--store", "--json") == EXIT_OK
    assert json.loads(capsys.readouterr().out)["stored"] is True
    assert load_camera(file).intrinsics.line_time == pytest.approx(0.03 / HEIGHT, rel=0.01)
    assert shutter(file, shown, "--mains", "60") == EXIT_OK
    save_camera(Camera(intrinsics=LENS.model_copy(update={"width": 100})), file, overwrite=True)
    assert shutter(file, shown) == EXIT_CONFIG
    assert "another size" in capsys.readouterr().err


def test_a_readout_that_no_camera_has_is_refused(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert shutter(file, pictures(file.parent, 0.09)) == EXIT_FAILURE
    assert "something else moves" in capsys.readouterr().err


def test_exact_levels_give_the_exact_curve() -> None:
    black, white = np.linspace(20, 60, 80), np.linspace(150, 230, 80)
    for gamma in (0.7, 1.0, 1.8, 3.0):
        middle = ((black**gamma + white**gamma) / 2) ** (1 / gamma)
        found, words = tone_curve(np.column_stack([black, middle, white]))
        assert found == pytest.approx(gamma, abs=0.011)
        assert " +- 0.00 from 80 edges" in words


def test_what_shows_no_curve_is_not_stored() -> None:
    few = np.tile([30.0, 120.0, 200.0], (5, 1))
    odd = np.tile([30.0, 199.0, 200.0], (80, 1))
    noisy = np.column_stack([np.full(80, 90.0), 112.0 + 30 * np.sin(np.arange(80.0) ** 2), np.full(80, 135.0)])
    for levels, words in ((few, "60 edges"), (odd, "no tone curve"), (noisy, "not known")):
        gamma, reason = tone_curve(levels)
        assert gamma == 1.0
        assert words in reason


def test_taken_back_grey_values_are_in_proportion_to_light() -> None:
    light = np.tile(np.linspace(0.02, 0.9, 160), (120, 1))
    image = (255 * light ** (1 / 2.2)).round().astype(np.uint8)
    found = in_light(image, 2.2).astype(float)
    assert np.corrcoef(found.ravel(), light.ravel())[0, 1] > 0.9999
    assert found.max() == pytest.approx(225.0, abs=4.0)
    assert in_light(image, 1.0) is image
    assert in_light(np.full((8, 8), 255, np.uint8), 2.2).min() == 255
    assert in_light(np.full((8, 8), 5, np.uint8), 2.2).max() < 10


def test_edges_that_are_pale_crushed_or_short_are_left_out() -> None:
    image = np.full((80, 80), 200, np.uint8)
    image[:, 40:] = 20
    edge = np.array([[[39.5, 10.0]], [[39.5, 70.0]]])
    assert edge_levels(image, edge) == pytest.approx(np.array([[20.0, 110.0, 200.0]]))
    for other in (image // 10, np.where(image > 100, 255, 60).astype(np.uint8), np.full_like(image, 90)):
        assert len(edge_levels(other, edge)) == 0
    assert len(edge_levels(image, np.array([[[39.5, 10.0]], [[39.5, 22.0]]]))) == 0
    assert len(edge_levels(image, np.full_like(edge, np.nan))) == 0

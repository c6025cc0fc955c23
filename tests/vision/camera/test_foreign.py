"""Calibrations of ROS and Kalibr, wherever a camera file is."""

from __future__ import annotations

from pathlib import Path

import pytest

from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import run
from mkdaemon.errors import ConfigError
from mkdaemon.vision.camera.calibration_file import load_camera

ROS = """image_width: 640
image_height: 480
camera_name: down
camera_matrix:
  rows: 3
  cols: 3
  data: [601.5, 0.0, 319.5, 0.0, 602.5,
         239.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.01, -0.02, 0.001, 0.002, 0.003]
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
"""
BLOCK = ROS.replace(
    "  data: [0.01, -0.02, 0.001, 0.002, 0.003]",
    "  data:\n" + "\n".join(f"  - {v}" for v in (0.01, -2e-2, 1e-3, 2e-3, 3e-3)),
)
OST = """# oST version 5.0 parameters


[image]

width
640

height
480

[down]

camera matrix
601.5 0.0 319.5
0.0 602.5 239.5
0.0 0.0 1.0

distortion
0.01 -0.02 0.001 0.002 0.003

rectification
1 0 0
0 1 0
0 0 1
"""
KALIBR = """cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [0.01, -0.02, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [601.5, 602.5, 319.5, 239.5]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
"""
FIGURES = {"width": 640, "height": 480, "fx": 601.5, "fy": 602.5, "cx": 319.5, "cy": 239.5}


def written(path: Path, text: str, name: str = "camera.yaml") -> Path:
    (path / name).write_text(text)
    return path / name


@pytest.mark.parametrize(
    ("text", "k3"), [(ROS, 0.003), (BLOCK, 0.003), (OST, 0.003), (KALIBR, 0.0), ("\ufeff" + ROS, 0.003)]
)
def test_the_figures_of_a_pinhole(tmp_path: Path, text: str, k3: float) -> None:
    k = load_camera(written(tmp_path, text)).intrinsics
    assert k.model_dump(include=set(FIGURES)) == FIGURES
    assert (k.model, list(k.distortion)) == ("pinhole", [0.01, -0.02, 0.001, 0.002, k3])


@pytest.mark.parametrize(
    "text", [ROS.replace("plumb_bob", "equidistant").replace(", 0.003]", "]"), KALIBR.replace("radtan", "equidistant")]
)
def test_the_figures_of_a_fisheye(tmp_path: Path, text: str) -> None:
    k = load_camera(written(tmp_path, text)).intrinsics
    assert (k.model, list(k.distortion)) == ("fisheye", [0.01, -0.02, 0.001, 0.002])


def test_a_rational_lens_whose_denominator_is_1_is_a_pinhole(tmp_path: Path) -> None:
    text = ROS.replace("plumb_bob", "rational_polynomial").replace("0.003]", "0.003, 0.0, 0.0, 0.0]")
    assert load_camera(written(tmp_path, text)).intrinsics.k3 == 0.003


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            ROS.replace("plumb_bob", "rational_polynomial").replace("0.003]", "0.003, 0.4, 0, 0]"),
            "with 0.4, 0, 0 after 5",
        ),
        (ROS.replace("0.003]", "0.003, 0.4, 0, 0]"), "plumb_bob with 0.4, 0, 0 after 5 coefficients has no place"),
        (ROS.replace("plumb_bob", "fov"), "distortion_model fov is not known; use one of plumb_bob"),
        (ROS.replace("601.5, 0.0", "601.5, 2.0"), "a skew of 2 has no place"),
        (ROS.replace("601.5", ".nan"), "camera_matrix holds what is not a number"),
        (ROS.replace("601.5", "nan"), "camera_matrix needs 9 finite numbers"),
        (ROS.replace("601.5", "6_01.5"), "camera_matrix holds what is not a number"),
        (ROS.replace("601.5, ", ""), "camera_matrix needs 9 finite numbers"),
        (ROS.replace("image_width: 640\n", ""), "image_width is missing"),
        (ROS.replace("640", "-640"), "width: Input should be greater than 0"),
        (ROS.replace("601.5", "6.0"), "no lens has a focal length"),
        (OST.replace("distortion\n", "other\n"), "distortion is missing"),
        (KALIBR.replace("pinhole", "omni"), "camera_model omni has no place"),
        (KALIBR + KALIBR.replace("cam0:", "cam1:"), "the file holds 2 cameras; keep the lines of one"),
    ],
)
def test_what_a_camera_file_cannot_say_is_refused(tmp_path: Path, text: str, says: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError, match=says) as caught:
        load_camera(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_import_writes_a_camera_file_and_never_over_the_calibration(tmp_path: Path) -> None:
    source, target = written(tmp_path, ROS), tmp_path / "camera.toml"
    assert run(mkdaemon, ["calibrate", "import", str(source), str(target)]) == 0
    assert load_camera(target).intrinsics == load_camera(source).intrinsics
    assert load_camera(target).name == "down"
    assert run(mkdaemon, ["calibrate", "import", str(source), str(source), "--force"]) == 2
    assert source.read_text() == ROS

"""Images of another renderer, with their true poses: tests/data/webots/README.md."""

from __future__ import annotations

import csv

import cv2
import numpy as np
import pytest

from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.still import StillEye
from tests.places import DATA

WEBOTS = DATA / "webots"
FOCAL = 400.0 / np.tan(0.3)
CAMERA = Intrinsics(width=800, height=800, fx=FOCAL, fy=FOCAL, cx=399.5, cy=399.5)
ROWS = list(csv.DictReader((WEBOTS / "locations.csv").read_text(encoding="utf-8").splitlines()))


@pytest.mark.parametrize("row", ROWS, ids=[row["name"] for row in ROWS])
def test_a_tag_of_another_renderer_is_posed(row: dict[str, str]) -> None:
    pixels = cv2.imread(str(WEBOTS / f"img-{int(row['Index']):03d}.png"), cv2.IMREAD_GRAYSCALE)
    (tag,) = StillEye(tag_size=0.2).look(np.asarray(pixels, dtype=np.uint8), CAMERA).tags
    assert (tag.found.tag_id, tag.found.hamming) == (14, 0)
    pose = tag.pose.pose
    truth = [-float(row["horizontal"]), -float(row["vertical"]), float(row["distance"])]
    np.testing.assert_allclose(pose.position, truth, atol=0.0015)
    tilt = np.arccos(np.cos(float(row["yaw"])) * np.cos(float(row["pitch"])))
    assert np.degrees(np.arccos(-pose.rotation[2, 2]) - tilt) == pytest.approx(0.0, abs=0.5)
    if float(row["yaw"]) == float(row["pitch"]) == 0.0:
        turned = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
        assert np.degrees(turned + float(row["roll"])) == pytest.approx(0.0, abs=0.1)

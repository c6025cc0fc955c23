"""One picture alone: images of another renderer with their true poses, and hints about pictures without tags."""

from __future__ import annotations

import csv

import cv2
import numpy as np
import pytest

from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.still import StillEye
from mkdaemon.vision.stillhints import hints
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


FAMILIES = ("tag36h11",)


def marker(side, *, border=1, code=3):
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return cv2.aruco.generateImageMarker(dictionary, code, side, borderBits=border)


def on_paper(*markers):
    """Tags side by side on white paper."""
    side = max(len(one) for one in markers)
    pixels = np.full((2 * side, 2 * side * len(markers)), 255, dtype=np.uint8)
    for number, one in enumerate(markers):
        left, top = 2 * side * number + side // 2, side // 2
        pixels[top : top + len(one), left : left + len(one)] = one
    return pixels


@pytest.mark.parametrize(
    ("pixels", "words"),
    [
        (on_paper(marker(80)), []),
        (np.full((120, 160), 200, dtype=np.uint8), []),
        (on_paper(marker(80, border=2)), ["a border of two cells"]),
        (on_paper(marker(80)) // 64, ["nearly black (brightest 3 of 255)"]),
        (on_paper(marker(8))[3:13, 3:13], ["the picture of 10 x 10 px is enlarged"]),
        (on_paper(marker(80), marker(80)), ["tag36h11 3 is seen 2 times"]),
        (on_paper(marker(80), marker(80, code=4)), []),
    ],
    ids=["good", "empty", "wide border", "dark", "small", "twice", "two"],
)
def test_a_hint_says_what_to_do_about_a_picture(pixels, words):
    eye = StillEye()
    told = list(hints(pixels, eye.look(pixels), eye, FAMILIES))
    assert len(told) == len(words)
    assert all(word in hint for word, hint in zip(words, told, strict=True))


def test_a_family_that_opencv_does_not_know_gets_no_hint_about_its_border():
    eye = StillEye(families=("tag25h9",))
    pixels = on_paper(marker(80, border=2))
    assert list(hints(pixels, eye.look(pixels), eye, ("tagCircle21h7",))) == []

"""What a person is told about a picture without tags, or with one twice."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mkdaemon.vision.still import StillEye
from mkdaemon.vision.stillhints import hints

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

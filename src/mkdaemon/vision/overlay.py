"""What was found, drawn over the image for people to look at."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import ConfigError
from mkdaemon.files import save
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.still import StillPose, StillResult

Colour = tuple[int, int, int]

SIDES: tuple[Colour, ...] = ((60, 60, 255), (80, 220, 80), (255, 160, 60), (220, 220, 220))
"""Top, right, bottom, left of the print, blue-green-red: a turned tag shows at a glance."""
AXES: tuple[Colour, ...] = ((60, 60, 255), (80, 220, 80), (255, 120, 60))


def draw(pixels: npt.NDArray[np.uint8], result: StillResult, intrinsics: Intrinsics | None) -> npt.NDArray[np.uint8]:
    """Draw tags with their ids, and the axes of every pose.

    Args:
        pixels: `(h, w)` uint8.
        result: of the same image.
        intrinsics: of the camera; without it no axes.

    Returns:
        `(h, w, 3)` uint8, blue-green-red.
    """
    picture = draw_tags(pixels, ((str(tag.found.tag_id), tag.found.corners) for tag in result.tags))
    if intrinsics is not None:
        for pose in result.poses:
            _axes(picture, pose, intrinsics, _scale(pixels))
    return picture


def draw_tags(
    pixels: npt.NDArray[np.uint8], tags: Iterable[tuple[str, npt.NDArray[np.float64]]]
) -> npt.NDArray[np.uint8]:
    """Draw outlines of tags.

    Args:
        pixels: `(h, w)` uint8.
        tags: what stands beside each, and its corners `(4, 2)` [px].

    Returns:
        `(h, w, 3)` uint8, blue-green-red.
    """
    picture = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    for label, corners in tags:
        _tag(picture, corners, label, _scale(pixels))
    return picture


def _scale(pixels: npt.NDArray[np.uint8]) -> float:
    """Of lines and letters, by the width of an image."""
    return float(max(pixels.shape[1] / 1000.0, 0.5))


def write_picture(path: Path, pixels: npt.NDArray[np.uint8], *, overwrite: bool = False) -> None:
    """Write a picture to a file, whole or not at all; its suffix chooses the format.

    Args:
        path: in a folder that exists.
        pixels: `(h, w, 3)` uint8, blue-green-red, or `(h, w)` uint8, grey.
        overwrite: replace a file that is there.

    Raises:
        ConfigError: the file is there already and `overwrite` is off, or no format has this suffix.
        MkError: it cannot be written; what was there is untouched.
    """
    try:
        is_encoded, content = cv2.imencode(path.suffix, pixels)
    except cv2.error:
        is_encoded = False
    if not is_encoded:
        msg = f"{path}: no format of pictures has this suffix; use .png or .jpg"
        raise ConfigError(msg)
    save(path, content.tobytes(), overwrite=overwrite)


def _tag(picture: npt.NDArray[np.uint8], corners: npt.NDArray[np.float64], label: str, scale: float) -> None:
    """The sides of a tag, each in its colour, and a word below."""
    for k in range(4):
        _line(picture, corners[k], corners[(k + 1) % 4], SIDES[k], scale)
    x, y = corners[3] + (0.0, 14.0 * scale)
    at = (round(float(x)), round(float(y)))
    cv2.putText(picture, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * scale, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * scale, (60, 230, 255), 1, cv2.LINE_AA)


def _axes(picture: npt.NDArray[np.uint8], found: StillPose, k: Intrinsics, scale: float) -> None:
    """Axes as long as a tenth of the distance; dotted down to nothing behind the lens."""
    length = 0.1 * found.pose.range_m
    points = np.array([[0, 0, 0], [length, 0, 0], [0, length, 0], [0, 0, length]]) @ found.pose.rotation.T
    points = points + found.pose.position
    if float(points[:, 2].min()) <= NEAR_M:
        return
    seen, _ = Projection(k).project(points)
    for end, colour in zip(seen[1:], AXES, strict=True):
        _line(picture, seen[0], end, colour, scale)


def _line(
    picture: npt.NDArray[np.uint8],
    start: npt.NDArray[np.floating],
    end: npt.NDArray[np.floating],
    colour: Colour,
    scale: float,
) -> None:
    a, b = (tuple(int(v) for v in np.clip(np.rint(point * 16), -(2**20), 2**20)) for point in (start, end))
    cv2.line(picture, (a[0], a[1]), (b[0], b[1]), colour, max(round(2 * scale), 1), cv2.LINE_AA, shift=4)

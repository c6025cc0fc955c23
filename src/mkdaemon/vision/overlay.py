"""What was found, drawn over the image for people to look at."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from mkdaemon.errors import ConfigError
from mkdaemon.files import save
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.still import StillResult

Colour = tuple[int, int, int]

SIDES: tuple[Colour, ...] = ((60, 60, 255), (80, 220, 80), (255, 160, 60), (220, 220, 220))
"""Top, right, bottom, left of the print, and the axes x, y, z [blue-green-red]: a turned tag shows at a glance."""


def draw(pixels: Grey, result: StillResult, intrinsics: Intrinsics | None) -> Grey:
    """Tags with ids, and the axes of poses where the lens is known, over `(h, w)`: blue-green-red `(h, w, 3)` uint8."""
    picture = draw_tags(pixels, ((str(tag.found.tag_id), tag.found.corners) for tag in result.tags))
    if intrinsics is not None:
        for pose in (found.pose for found in result.poses):
            # as long as a tenth of the distance; none that reach behind the lens
            length = 0.1 * pose.range_m
            points = length * np.vstack([np.zeros(3), np.eye(3)]) @ pose.rotation.T + pose.position
            if float(points[:, 2].min()) > NEAR_M:
                seen, _ = Projection(intrinsics).project(points)
                for end, colour in zip(seen[1:], SIDES[:3], strict=True):
                    _line(picture, seen[0], end, colour)
    return picture


def draw_tags(pixels: Grey, tags: Iterable[tuple[str, Array]]) -> Grey:
    """Labels and outlines `(4, 2)` [px] of tags over `(h, w)` uint8: blue-green-red `(h, w, 3)` uint8."""
    picture = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    scale = _scale(picture)
    for label, corners in tags:
        for start, end, colour in zip(corners, np.roll(corners, -1, axis=0), SIDES, strict=True):
            _line(picture, start, end, colour)
        x, y = corners[3] + (0.0, 14.0 * scale)
        at = (round(float(x)), round(float(y)))
        for colour, width in (((0, 0, 0), 3), ((60, 230, 255), 1)):
            cv2.putText(picture, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * scale, colour, width, cv2.LINE_AA)
    return picture


def write_picture(path: Path, pixels: Grey, *, overwrite: bool = False) -> None:
    """Write a picture, `(h, w, 3)` blue-green-red or `(h, w)` grey, whole or not at all; the suffix is the format.

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


def _line(picture: Grey, start: Array, end: Array, colour: Colour) -> None:
    a, b = (tuple(int(v) for v in np.clip(np.rint(point * 16), -(2**20), 2**20)) for point in (start, end))
    cv2.line(picture, (a[0], a[1]), (b[0], b[1]), colour, max(round(2 * _scale(picture)), 1), cv2.LINE_AA, shift=4)


def _scale(picture: Grey) -> float:
    """Of lines and letters, by the width of an image."""
    return float(max(picture.shape[1] / 1000.0, 0.5))

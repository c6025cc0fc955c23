"""A video or a photograph that its metadata turns is read as the sensor saw it: the lens is fixed to that."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.vision.camera.imagecodec import read_picture
from mkdaemon.vision.camera.sources import open_clip

WIDTH, HEIGHT = 64, 48
ONE, LAST = 1 << 16, 1 << 30
TURNS = {
    90: (0, ONE, 0, -ONE, 0, 0, HEIGHT * ONE, 0, LAST),
    180: (-ONE, 0, 0, 0, -ONE, 0, WIDTH * ONE, HEIGHT * ONE, LAST),
    270: (0, -ONE, 0, ONE, 0, 0, 0, WIDTH * ONE, LAST),
}
"""Display matrices of a track header. Source: ISO/IEC 14496-12, 8.3.2."""


def video(path: Path, matrix: tuple[int, ...] | None) -> Path:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[:16, :16] = 255  # white above on the left
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (WIDTH, HEIGHT))
    for _ in range(3):
        writer.write(image)
    writer.release()
    if matrix is not None:
        raw = path.read_bytes()
        at = raw.index(b"tkhd") + 4 + 4 + 20 + 16
        path.write_bytes(raw[:at] + struct.pack(">9i", *matrix) + raw[at + 36 :])
    return path


@pytest.mark.parametrize("turn", [None, *TURNS])
def test_a_turned_video_is_read_as_the_sensor_saw_it(tmp_path: Path, turn: int | None) -> None:
    _, first = next(iter(open_clip(video(tmp_path / "a.mp4", TURNS.get(turn or 0)))))
    pixels = first()
    assert pixels.shape[:2] == (HEIGHT, WIDTH)
    assert pixels[:12, :12].mean() > 200 > 50 > pixels[-12:, -12:].mean()


def exif(orientation: int) -> bytes:
    """One tag, 0x0112, a short. Source: Exif 2.32, 4.6.4."""
    return b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)


def as_jpeg(image: np.ndarray, orientation: int) -> bytes:
    jpeg = cv2.imencode(".jpg", image)[1].tobytes()
    segment = b"Exif\0\0" + exif(orientation)
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + jpeg[2:]


def as_png(image: np.ndarray, orientation: int) -> bytes:
    png, chunk = cv2.imencode(".png", image)[1].tobytes(), b"eXIf" + exif(orientation)
    end = 8 + 25  # behind signature and IHDR
    return png[:end] + struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) + png[end:]


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("coded", [as_jpeg, as_png])
def test_a_turned_photograph_is_read_as_the_sensor_saw_it(tmp_path: Path, coded, orientation: int) -> None:
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    image[:16, :16] = 255
    path = tmp_path / "a.picture"
    path.write_bytes(coded(image, orientation))
    turned = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert orientation == 1 or turned[:12, :12].mean() < 200 or turned.shape != image.shape, "other programs turn it"
    pixels = read_picture(path)
    assert pixels.shape == (HEIGHT, WIDTH)
    assert pixels[:12, :12].mean() > 200 > 50 > pixels[-12:, -12:].mean()

"""A video that its metadata turns is read as the sensor saw it: the lens is fixed to that."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

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

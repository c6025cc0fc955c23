"""Images survive the wire, and are read as the sensor saw them; what comes damaged is refused with a reason."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import msgpack
import numpy as np
import pytest

from mkdaemon.bus.codec import encode
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import (
    captured_pixels,
    decode_picture,
    encode_jpeg,
    read_picture,
    unpack,
)
from mkdaemon.vision.camera.sources import open_clip

PIXELS = np.arange(12 * 16, dtype=np.uint8).reshape(12, 16)
FRAME = CameraFrame(
    camera="c",
    sequence=3,
    width=16,
    height=12,
    coding="gray8",
    stamp=Stamp(monotonic=1.0, wall=1.5e9),
    pixels=PIXELS.tobytes(),
)  # fmt: skip


def test_grey_pixels_and_png_come_back_as_they_went() -> None:
    png = FRAME.model_copy(update={"coding": "png", "pixels": cv2.imencode(".png", PIXELS)[1].tobytes()})
    for frame in (FRAME, png):
        found = unpack(encode(frame))
        assert found[0] == frame
        np.testing.assert_array_equal(found[1], PIXELS)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width": 15}, "has 192 bytes"),
        ({"width": 0}, "width"),
        ({"width": 16000, "height": 16000}, "has 192 bytes"),
        ({"coding": "jpeg"}, "no picture"),
        ({"coding": "gif"}, "coding"),
        ({"stamp": {"monotonic": 1.0, "wall": float("nan")}}, "stamp.wall"),
        ({"pixels": b""}, "has 0 bytes"),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, object], words: str) -> None:
    with pytest.raises(PictureError, match=words):
        unpack(msgpack.packb({**dict(FRAME), **change}, default=vars))


def test_a_header_that_lies_about_its_picture_is_refused() -> None:
    jpeg, _, _ = encode_jpeg(PIXELS, 80, 100)
    with pytest.raises(PictureError, match="header says 32x12, the picture is 16x12"):
        unpack(encode(FRAME.model_copy(update={"coding": "jpeg", "pixels": jpeg, "width": 32})))


def textured(width: int = 160, height: int = 120) -> np.ndarray:
    noise = np.random.default_rng(5).integers(0, 256, (height // 8, width // 8), dtype=np.uint8)
    return cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)


def cut(jpeg: bytes, place: int, length: int) -> bytes:
    return jpeg[:place] + jpeg[place + length :]


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda jpeg: jpeg[: len(jpeg) // 2], id="end missing"),
        pytest.param(lambda jpeg: jpeg[: len(jpeg) // 2] + jpeg[-2:], id="end missing, marker there"),
        pytest.param(lambda jpeg: cut(jpeg, len(jpeg) // 2, 300), id="packet lost"),
        pytest.param(lambda jpeg: jpeg[: len(jpeg) // 2] + bytes(200) + jpeg[len(jpeg) // 2 + 200 :], id="zeros"),
        pytest.param(lambda jpeg: jpeg[: len(jpeg) // 2] + jpeg[len(jpeg) // 2 - 400 :], id="packet twice"),
    ],
)
def test_a_jpeg_that_libjpeg_warns_about_is_refused(
    damage: Callable[[bytes], bytes],
) -> None:
    jpeg = cv2.imencode(".jpg", cv2.merge([textured()] * 3), [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    np.testing.assert_array_equal(
        decode_picture(jpeg), cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    )
    with pytest.raises(PictureError, match="damaged JPEG"):
        decode_picture(damage(jpeg))


@pytest.mark.parametrize(
    ("image", "shape"),
    [
        (np.zeros((4, 6, 3), np.uint8), (4, 6)),
        (np.zeros((4, 6, 4), np.uint8), (4, 6)),
        (np.zeros((4, 6, 1), np.uint8), (4, 6)),
        (np.full((4, 6), 51200, np.uint16), (4, 6)),
        (np.zeros((4, 6, 2), np.uint8), None),
        (np.zeros((4, 6)), None),
        (np.zeros((0, 6), np.uint8), None),
    ],
)
def test_any_capture_becomes_grey_or_is_refused(image: np.ndarray, shape: tuple[int, int] | None) -> None:
    if shape is None:
        with pytest.raises(PictureError, match="no picture"):
            captured_pixels(image)
        return
    grey = captured_pixels(image)
    assert grey.shape == shape
    if image.dtype == np.uint16:
        assert grey[0, 0] == 200


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

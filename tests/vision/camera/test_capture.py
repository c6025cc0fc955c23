"""An H.264 stream that changes the size of its pictures: what OpenCV scales is refused, with its reason."""

from __future__ import annotations

import base64
import socket
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import VisionError
from mkdaemon.vision.camera.capture import ClipSource, SizeWatch
from mkdaemon.vision.camera.image import EndOfImages, PictureError
from mkdaemon.vision.camera.sources import source_of
from tests.vision.camera import h264
from tests.vision.camera.network_cameras import NetworkCamera

SMALL, LARGE = (64, 96), (96, 128)
"""Heights and widths [px]."""


def picture(shape: tuple[int, int], number: int = 0) -> npt.NDArray[np.uint8]:
    """A bar over a quarter of the height."""
    pixels = np.full(shape, 60, np.uint8)
    pixels[shape[0] // 4 : shape[0] // 2, 8 * (number % 4) :] = 200
    return pixels


REAL = {
    "x264, 1080p, cropped": (bytes.fromhex("67640028acd940780227e5c0440000030004000003 00f03c60c658"), (1920, 1080)),
    "x264, 360p, high": (base64.b64decode("Z2QAHqzZQKAv+XARAAADAAEAAAMAPA8WLZY="), (640, 360)),
    "camera, main": (base64.b64decode("Z01AHpZUBQHtgKg="), (640, 480)),
    "x265, 1080p, cropped": (
        bytes.fromhex("420101016000000300900000030000030078a003c08010e596566924caf01010000003001000000301e080"),
        (1920, 1080),
    ),
}
"""Sequence parameter sets that encoders wrote."""


def packet(unit: bytes) -> bytes:
    """A sequence parameter set with the sets it stands between, and a picture, of which little is right."""
    if unit[0] & 0x1F == 7:
        _, _, rest = h264.key_frame(picture(LARGE)).partition(b"\0\0\0\1\x68")
        return b"\0\0\0\1" + unit + b"\0\0\0\1\x68" + rest
    video = bytes.fromhex("40010c01ffff016000000300900000030000030078959809")
    return b"".join(b"\0\0\0\1" + part for part in (video, unit, bytes.fromhex("4401c172b46240"), b"\x26\x01\xaf\x08"))


def watched(folder: Path, content: bytes) -> str:
    """What is said of a stream that was opened with the small size."""
    opened, clip = folder / "opened.h264", folder / "clip.h264"
    opened.write_bytes(h264.key_frame(picture(SMALL)))
    clip.write_bytes(content)
    watch = SizeWatch(str(clip), cv2.VideoCapture(str(opened), cv2.CAP_FFMPEG, []))
    while watch.step():
        continue
    watch.close()
    return watch.change


@pytest.mark.parametrize("name", REAL)
def test_the_size_stands_in_the_parameter_set(name: str, tmp_path: Path) -> None:
    unit, (width, height) = REAL[name]
    assert f"{width}x{height} and not 96x64" in watched(tmp_path, packet(unit))
    for end in range(1, len(unit)):
        watched(tmp_path, packet(unit[:end]))  # cut off anywhere: no fault


def test_a_parameter_set_without_an_end_tells_no_size(tmp_path: Path) -> None:
    """Two million entries are announced and come."""
    announced = "1" + "1" + "010" + "1" + "1" + "1" + "0" * 20 + "1" * 21
    head = int(announced.ljust(80, "1"), 2).to_bytes(10, "big")
    endless = b"\x67\x42\x00\x1e" + head + b"\xff" * 1_000_000
    assert watched(tmp_path, h264.key_frame(picture(SMALL)) + packet(endless)) == ""


@pytest.mark.parametrize("size", [(16, 16), (320, 240)])
def test_pictures_as_large_as_the_stream_was_opened_are_no_change(size: tuple[int, int], tmp_path: Path) -> None:
    clip = tmp_path / "clip.h264"
    clip.write_bytes(h264.key_frame(picture(size[::-1])))
    watch = SizeWatch(str(clip), cv2.VideoCapture(str(clip), cv2.CAP_FFMPEG, []))
    assert watch.step()
    assert watch.change == ""


def read_all(source: ClipSource) -> list[str]:
    """What a clip shows: the size of an image, or why there is none."""
    shown = []
    while True:
        try:
            height, width = source.read(0.0).pixels.shape  # type: ignore[union-attr]
            shown.append(f"{width}x{height}")
        except PictureError as error:
            shown.append(str(error))
        except EndOfImages:
            return shown


def test_a_clip_is_read_as_long_as_its_pictures_have_the_size_it_was_opened_with(tmp_path: Path) -> None:
    clip = tmp_path / "clip.h264"
    parts = [(SMALL, 3, 0), (LARGE, 4, 1), (SMALL, 2, 0)]
    clip.write_bytes(b"".join(h264.stream(picture(shape), count, number) for shape, count, number in parts))
    capture = cv2.VideoCapture(str(clip), cv2.CAP_FFMPEG, [])
    sizes = {capture.read()[1].shape[:2] for _ in range(9)}
    assert sizes in ({SMALL}, {LARGE})  # OpenCV scales all of them to one size

    shape = sizes.pop()
    source = ClipSource(clip, CameraSection(source=f"file:{clip}", paced=False))
    source.open()
    shown = read_all(source)
    source.close()
    right = f"{shape[1]}x{shape[0]}"
    assert [text == right for text in shown] == [s == shape for s, count, _ in parts for _ in range(count)]
    refusal = next(text for text in shown if text != right)
    assert "128x96" in refusal
    assert "96x64" in refusal
    assert "fixed resolution" in refusal


class ChangingCamera(NetworkCamera):
    """H.264 over HTTP, every picture a key frame; its size changes when told."""

    shape = SMALL
    clients = 0

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/stream"

    def serve(self, client: socket.socket) -> None:
        self.clients += 1
        client.recv(4096)
        client.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: video/h264\r\n\r\n")
        for number in self.pictures():
            client.sendall(h264.key_frame(picture(self.shape, number), number % 2))


@pytest.fixture(autouse=True)
def short_probing(monkeypatch: pytest.MonkeyPatch) -> None:
    """FFmpeg looks at a stream for half a second before it opens it; here it does not."""
    monkeypatch.setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", "probesize;20000|analyzeduration;0")


def test_a_network_camera_that_changes_its_size_is_opened_again() -> None:
    with ChangingCamera(0.002) as camera:
        source = source_of(CameraSection(source=camera.address))
        assert source.open() == ()
        for _ in range(50):
            shot = source.read(0.1)
            assert shot is not None
            assert shot.pixels.shape == SMALL
        camera.shape = LARGE
        with pytest.raises(VisionError, match="128x96 and not 96x64"):
            while True:
                source.read(0.1)
        source.close()
        source.open()
        shot = source.read(0.1)
        source.close()
    assert shot is not None
    assert shot.pixels.shape == LARGE


def test_a_camera_that_takes_one_client_only_is_not_watched_again() -> None:
    class Jealous(ChangingCamera):
        def serve(self, client: socket.socket) -> None:
            for other in self._clients[:-1]:
                other.close()
            super().serve(client)

    with Jealous(0.002) as camera:
        source = source_of(CameraSection(source=camera.address))
        for _ in range(2):
            assert source.open() == ()
            with pytest.raises(VisionError, match="no more images"):
                while True:
                    source.read(0.1)
            source.close()
        assert any("watch_size" in refused for refused in source.open())
        assert source.read(0.1) is not None
        source.close()


def test_nobody_watches_where_nobody_is_asked_to() -> None:
    with ChangingCamera(0.002) as camera:
        source = source_of(CameraSection(source=camera.address, watch_size=False))
        assert any("watch_size" in refused for refused in source.open())
        assert source.read(0.1) is not None
        source.close()
        assert camera.clients == 1

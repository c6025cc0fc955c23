"""Network cameras through FFmpeg: images come, the camera may go and return, and its stamps are what they are."""

from __future__ import annotations

import contextlib
import socket
import socketserver
import threading
from collections.abc import Callable
from typing import Self

import cv2
import numpy as np

from mkdaemon.config.camera import CameraSection
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.camera.sources import source_of
from tests.bus.support import free_endpoint
from tests.vision.streams import wait_for_status

WIDTH, HEIGHT = 160, 120
BOUNDARY = "image"


def jpeg(number: int, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    """Picture `number`: its brightness tells it from the others."""
    pixels = np.full((height, width, 3), 40 + 10 * (number % 20), np.uint8)
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()


class HttpCamera(socketserver.ThreadingTCPServer):
    """Motion JPEG, without time stamps on the way: accepts clients until it is left; each gets its own pictures.

    Args:
        period: between pictures [s].
        port: any free one where it is 0.
        picture: what picture number n is.
    """

    allow_reuse_address = daemon_threads = True

    def __init__(self, period: float, port: int = 0, picture: Callable[[int], bytes] = jpeg) -> None:
        super().__init__(("127.0.0.1", port), socketserver.BaseRequestHandler)
        self.address = f"http://127.0.0.1:{self.server_address[1]}/stream"
        self._period, self._picture = period, picture
        self._off = threading.Event()

    def __enter__(self) -> Self:
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._off.set()
        self.shutdown()
        self.server_close()

    def finish_request(self, request: socket.socket, client_address: object) -> None:
        with contextlib.suppress(OSError):  # the client has gone
            request.recv(4096)
            kind = f"multipart/x-mixed-replace; boundary={BOUNDARY}"
            request.sendall(f"HTTP/1.0 200 OK\r\nContent-Type: {kind}\r\n\r\n".encode())
            number = 0
            while not self._off.wait(self._period):
                number += 1
                content = self._picture(number)
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(content)}\r\n\r\n"
                request.sendall(head.encode() + content + b"\r\n")


PATIENCE = 60.0


def watch(address: str) -> tuple[CameraStream, NewestSlot[CameraImage]]:
    cfg = CameraSection(source=address, reopen_min=0.05, reopen_max=5.0)
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg), slot)
    stream.start()
    return stream, slot


def test_a_network_camera_is_seen_lost_and_found_again() -> None:
    port = int(free_endpoint().rpartition(":")[2])  # nobody takes it while the camera is gone
    with HttpCamera(0.02, port) as camera:
        address = camera.address
        stream, slot = watch(address)
        status = wait_for_status(stream, lambda s: s.images >= 5)
        assert (status.width, status.height) == (WIDTH, HEIGHT)
        image = slot.take(PATIENCE)
        grey = int(image.pixels.mean())
        assert min(abs(grey - 40 - 10 * number) for number in range(20)) <= 2
    status = wait_for_status(stream, lambda s: s.state is EyeState.GONE)
    assert address in status.reason
    seen = status.images
    with HttpCamera(0.02, port):
        wait_for_status(stream, lambda s: s.state is EyeState.OK and s.images > seen)
        stream.stop()


def test_a_damaged_image_of_a_stream_is_counted_named_and_not_handed_on() -> None:
    with HttpCamera(0.02, picture=lambda n: jpeg(n)[:-40] + jpeg(n)[-2:] if n % 2 else jpeg(n)) as camera:
        stream, _ = watch(camera.address)
        status = wait_for_status(stream, lambda s: s.damaged >= 3 and s.images >= 3)
        assert "damaged JPEG" in status.damage
        assert status.state is EyeState.OK
        stream.stop()

"""Waiting for a camera stream, whose thread works on its own."""

from __future__ import annotations

from collections.abc import Callable

from lab.rigs.waiting import wait_blocking
from mkdaemon.vision.camera.camera import CameraStream, StreamStatus


def wait_for_status(stream: CameraStream, wanted: Callable[[StreamStatus], bool]) -> StreamStatus:
    """Wait until a stream says what is wanted, and return its status then.

    Raises:
        TimeoutError: it never did.
    """
    wait_blocking(lambda: wanted(stream.status()), step=0.005)
    return stream.status()

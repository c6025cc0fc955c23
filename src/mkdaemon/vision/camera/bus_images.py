"""Images from a key on the bus: another machine's camera, or the simulator's."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import zenoh

from mkdaemon.clock import Clock
from mkdaemon.errors import VisionError
from mkdaemon.vision.camera.imagecodec import unpack
from mkdaemon.vision.camera.shot import Shot


class ZenohSource:
    """Images from a key on the bus: another machine's camera, or the simulator's."""

    live = True

    def __init__(self, key: str, session: Callable[[], zenoh.Session]) -> None:
        self._key = key
        self._session = session
        self._clock = Clock()
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._arrival = threading.Condition()
        self._newest: tuple[bytes, float] | None = None

    def open(self) -> tuple[str, ...]:
        """Subscribe with a direct callback that only keeps the newest payload."""
        try:
            self._subscriber = self._session().declare_subscriber(
                self._key, zenoh.handlers.Callback(self._on_sample, indirect=False)
            )
        except zenoh.ZError as error:
            msg = f"zenoh:{self._key}: {str(error).partition(' at ')[0]}"
            raise VisionError(msg) from error
        return ()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        with self._arrival:
            self._newest = (sample.payload.to_bytes(), time.monotonic())
            self._arrival.notify()

    def read(self, timeout: float) -> Shot | None:
        """Newest image."""
        with self._arrival:
            self._arrival.wait_for(lambda: self._newest is not None, timeout)
            taken, self._newest = self._newest, None
        if taken is None:
            return None
        payload, arrived = taken
        frame, pixels = unpack(payload)
        return Shot(pixels, arrived, self._clock.monotonic_of(frame.stamp), frame.sequence)

    def close(self) -> None:
        """End the subscription."""
        if self._subscriber is not None:
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
            self._subscriber = None

"""Images from a key on the bus: another machine's camera, or the simulator's."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import zenoh

from mkdaemon.clock import Clock
from mkdaemon.errors import VisionError
from mkdaemon.telemetry.signature import Signature, private_key
from mkdaemon.vision.camera.imagecodec import unpack
from mkdaemon.vision.camera.shot import PictureError, Shot
from mkdaemon.vision.camera.slot import NewestSlot

STRANGERS_LOOK: Final = 1.0
"""Time between two looks for images of somebody else [s]."""


class ZenohSource:
    """Images from a key on the bus: another machine's camera, or the simulator's."""

    live = True

    def __init__(self, key: str, session: Callable[[], zenoh.Session], secret: str | None = None) -> None:
        """Prepare.

        Args:
            key: plain and whole.
            session: gives an open one.
            secret: with which the sender signs them, and without which nobody knows the key they come to; None takes
                images from whoever puts them.
        """
        self._key, self._session, self._secret = key, session, secret
        self._clock = Clock()
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._strangers: zenoh.Subscriber[Any] | None = None
        self._newest: NewestSlot[tuple[bytes, float]] = NewestSlot()
        self._look_at = 0.0

    def open(self) -> tuple[str, ...]:
        """Subscribe with a direct callback that only keeps the newest payload."""
        try:
            session, secret = self._session(), self._secret
            key = self._key if secret is None else private_key(secret, self._key)
            self._subscriber = session.declare_subscriber(key, zenoh.handlers.Callback(self._on_sample, indirect=False))
            if secret is not None:  # kept without Python, the newest alone
                self._strangers = session.declare_subscriber(self._key, zenoh.handlers.RingChannel(1))
        except zenoh.ZError as error:
            msg = f"zenoh:{self._key}: {str(error).partition(' at ')[0]}"
            raise VisionError(msg) from error
        return ()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        payload, proof = sample.payload.to_bytes(), sample.attachment
        if self._secret is not None:
            signature = Signature(self._key, payload, b"" if proof is None else proof.to_bytes())
            if not signature.is_by(self._secret):
                return
        self._newest.put((payload, time.monotonic()))

    def _require_no_stranger(self) -> None:
        """Make sure that nobody put an image to the plain key since the last look, one a second at most.

        Raises:
            PictureError: somebody did.
        """
        if self._strangers is None or time.monotonic() < self._look_at:
            return
        self._look_at = time.monotonic() + STRANGERS_LOOK
        if self._strangers.handler.try_recv() is not None:
            msg = f"somebody without the secret of this camera puts images to {self._key}: they are not looked at"
            raise PictureError(msg)

    def read(self, timeout: float) -> Shot | None:
        """Newest image."""
        self._require_no_stranger()
        taken = self._newest.take(timeout)
        if taken is None:
            return None
        payload, arrived = taken
        frame, pixels = unpack(payload)
        return Shot(pixels, arrived, self._clock.monotonic_of(frame.stamp), frame.sequence)

    def close(self) -> None:
        """End the subscriptions."""
        for subscriber in filter(None, (self._strangers, self._subscriber)):
            subscriber.undeclare()  # type: ignore[no-untyped-call]
        self._strangers = self._subscriber = None

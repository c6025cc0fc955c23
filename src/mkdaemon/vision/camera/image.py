"""Images as sources give them, and as they are handed on with the times that make them usable."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass
from typing import Final, Generic, NamedTuple, Protocol, TypeVar

import cv2
import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.exposure import V4l2Controls
from mkdaemon.vision.limits import LIMITS

T = TypeVar("T")
BRIGHTEST: Final = 255.0
"""The largest grey value, which what is blown has."""
WHITE: Final = 225.0
"""Grey value that the brightest pixel gets, so that a dark image keeps its steps; the paper of a far target is less
than 0.5 % of an image, so no percentile would do."""
DARKEST: Final = 30.0
"""The brightest pixel is taken to be at least this bright [grey]."""


class Shot(NamedTuple):
    """One image as it left the source.

    Attributes:
        pixels: `(h, w)` uint8.
        arrived: [s; monotonic].
        stamp: the source's own time of capture [s; any clock, monotonic where it is ours], None where it has none.
        stamped_by: who gave the stamp.
        sequence: the source's own count, None where it has none.
    """

    pixels: Grey
    arrived: float
    stamp: float | None = None
    stamped_by: str = "driver"
    sequence: int | None = None


class ImageSource(Protocol):
    """A place images come from; used from one thread."""

    live: bool = True
    """Images arrive at their own time and are lost if they are not taken."""
    controls: V4l2Controls | None = None
    """What sets the exposure of the open camera; None if it accepts nothing, or was not requested."""

    def open(self) -> tuple[str, ...]:
        """Start; returns what was asked for and refused by the driver.

        Raises:
            VisionError: not there or unusable, in one sentence.
        """

    def read(self, timeout: float) -> Shot | None:
        """Wait up to about `timeout` [s] for an image; None when none came.

        Raises:
            PictureError: an image came and is none, or is damaged.
            VisionError: the source is gone.
            EndOfImages: a file or folder is at its end.
        """

    def close(self) -> None:
        """Close it; harmless if not open."""


class PictureError(VisionError):
    """Bytes that are no whole picture; says what is wrong with them."""


class EndOfImages(Exception):  # noqa: N818 - an end is no error
    """A file or folder has no more images."""


@dataclass(frozen=True, slots=True)
class CameraImage:
    """A grey image and when its exposure was centred.

    Attributes:
        pixels: `(height, width)` uint8.
        captured_at: middle of the exposure, monotonic clock of this machine [s].
        received_at: when the daemon had it, monotonic [s].
        sequence: counts images of this camera; a gap is a lost image.
        camera: name of the camera in the configuration.
        stamped_by: who knew `captured_at`: `driver`, `header` or `arrival` (the worst).
    """

    pixels: Grey
    captured_at: float
    received_at: float
    sequence: int
    camera: str
    stamped_by: str = "arrival"


class NewestSlot(Generic[T]):
    """The only queue in the image path: hands values from the threads of its senders to one reader.

    The newest value of a sender replaces the one before, which is `dropped` if it was not taken. Senders take turns.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: dict[str, T] = {}
        self._closed = False
        self.dropped: Counter[str] = Counter()

    def put(self, value: T, sender: str = "") -> None:
        """Replace whatever is there of this sender."""
        with self._changed:
            self.dropped[sender] += sender in self._waiting
            self._waiting[sender] = value
            self._changed.notify_all()

    def take(self, timeout: float) -> T | None:
        """Wait up to `timeout` [s] for a value and take it out; None when there is none or the slot is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, timeout)
            if not self._waiting:
                return None
            self._changed.notify_all()
            return self._waiting.pop(next(iter(self._waiting)))

    def wait_taken(self, sender: str) -> None:
        """Wait until nothing of a sender is left: for sources that must not outrun the reader."""
        with self._changed:
            self._changed.wait_for(lambda: sender not in self._waiting or self._closed)

    def close(self) -> None:
        """Wake all waiting callers; no later call waits."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


def in_light(pixels: Grey, gamma: float) -> Grey:
    """Grey values `(h, w)` in proportion to light, of light to the power 1 / gamma; saturated pixels stay so."""
    if gamma == 1.0:
        return pixels
    bright = max(float(pixels[::4, ::4].max()), DARKEST)
    table = np.clip(WHITE * (np.arange(256) / bright) ** gamma, 0.0, 255.0).round().astype(np.uint8)
    table[LIMITS.read.saturated :] = 255
    return np.asarray(cv2.LUT(pixels, table), dtype=np.uint8)

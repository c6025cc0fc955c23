"""What every source of images gives and promises."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError

Grey = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Shot:
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


class Source(Protocol):
    """A place images come from; used from one thread."""

    live: bool
    """Images come on their own time and are lost when nobody takes them."""

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
        """Let go of it; harmless when not open."""


class PictureError(VisionError):
    """Bytes that are no whole picture; says what is wrong with them."""


class EndOfImages(Exception):  # noqa: N818 - an end is no error
    """A file or folder has no more images."""

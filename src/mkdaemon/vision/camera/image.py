"""One image with the times that make it usable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

BRIGHTEST: Final = 255.0
"""The largest grey value, which what is blown has."""


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

    pixels: npt.NDArray[np.uint8]
    captured_at: float
    received_at: float
    sequence: int
    camera: str
    stamped_by: str = "arrival"

"""Images on the bus: what a camera saw and when. The same model carries images to the daemon and away from it.

The stamp is the middle of the exposure, on the sender's clocks.
"""

from typing import Literal

from pydantic import Field

from mkdaemon.telemetry.base import Stamped


class CameraFrame(Stamped):
    """One grey image: `vision/<camera>/image`, and any key a camera's `zenoh:` source names."""

    camera: str = ""
    """Name of the camera."""
    sequence: int = Field(default=0, ge=0)
    """Counts the camera's images; a gap is a lost image."""
    width: int = Field(gt=0, le=16384)
    """[px]."""
    height: int = Field(gt=0, le=16384)
    """[px]."""
    coding: Literal["gray8", "jpeg", "png"]
    """How `pixels` is stored; `gray8` is one byte a pixel, rows from the top."""
    pixels: bytes
    """The image."""

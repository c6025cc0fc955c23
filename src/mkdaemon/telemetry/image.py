"""Images on the bus: what a camera saw and when. The same model carries images to the daemon and away from it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mkdaemon.telemetry.base import Telemetry


class CameraFrame(Telemetry):
    """One grey image: `vision/<camera>/image`, and any key a camera's `zenoh:` source names."""

    camera: str = ""
    """Who took it."""
    sequence: int = Field(default=0, ge=0)
    """Counts the camera's images; a gap is a lost image."""
    width: int = Field(gt=0, le=16384)
    """[px]."""
    height: int = Field(gt=0, le=16384)
    """[px]."""
    coding: Literal["gray8", "jpeg", "png"]
    """How `pixels` is stored; `gray8` is one byte a pixel, rows from the top."""
    captured_wall: float
    """Middle of the exposure, Unix time [s]."""
    captured_monotonic: float | None = None
    """The same on the sender's monotonic clock [s]; meaningful where `clock` is equal."""
    clock: str = ""
    """Names the clock of `captured_monotonic`: the boot id of the machine, empty when unknown."""
    pixels: bytes
    """The image."""

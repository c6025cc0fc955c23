"""Configuration of the daemon's own recorder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mkdaemon.config.base import RELOADABLE, Section


class RecordedImages(Section):
    """Which images of the cameras are recorded."""

    hz: Annotated[float, RELOADABLE] = Field(default=2.0, ge=0.0, le=120.0)
    """Images a second and camera; 0 for none. A replay of vision needs every image, as `png`.

    Higher fills the disk: 5.5 MB a second at 30 Hz, 640x480 and `png`."""
    coding: Annotated[Literal["jpeg", "png"], RELOADABLE] = "jpeg"
    """`jpeg` is small, `png` is exact and takes five times the room.

    A replay of vision with `jpeg` images gives other poses."""
    jpeg_quality: Annotated[int, RELOADABLE] = Field(default=80, ge=1, le=100)
    """100 is the best.

    Lower blurs tags in the recording."""


class RecordConfig(Section):
    """The black box: what the daemon publishes, receives and decides, in files."""

    enabled: bool = True
    """Record whenever the daemon runs; a recording that plays is not recorded again.

    False: a flight cannot be examined afterwards."""
    folder: Path | None = None
    """Where; unset: `recordings` in the folder of `vehicle.state_folder`.

    On a slow disk entries are lost and counted."""
    file_mb: Annotated[int, RELOADABLE] = Field(default=200, ge=1)
    """Size at which a new file begins [MB].

    Smaller makes many files."""
    file_minutes: Annotated[float, RELOADABLE] = Field(default=30.0, gt=0.0)
    """Age at which a new file begins [min].

    Shorter makes many files."""
    total_mb: Annotated[int, RELOADABLE] = Field(default=4000, ge=1)
    """Largest size of all recordings of this vehicle in the folder [MB].

    Smaller deletes old flights sooner."""
    free_mb: Annotated[int, RELOADABLE] = Field(default=1000, ge=1)
    """Disk space reserved for other programs [MB].

    Smaller lets recordings fill the disk of the system."""
    delete_oldest: Annotated[bool, RELOADABLE] = True
    """Delete this vehicle's oldest recordings to stay within `total_mb` and `free_mb`; else recording stops there.

    With false, recording stops when the space is used up."""
    sync_s: float = Field(default=5.0, ge=0.0)
    """Interval between two flushes to the disk, which protect data against a power failure [s]; 0: as the system does.
    Data written before the daemon is killed survives in any case.

    Longer loses more at a power failure; shorter wears out a memory card."""
    queue_mb: int = Field(default=32, ge=1, le=1024)
    """Largest amount that waits in memory for a slow disk; beyond it entries are lost and counted [MB].

    Smaller loses entries on a slow disk; larger takes memory."""
    json_for_viewers: bool = False
    """Add JSON for viewers; it takes twice the room and delays setpoints (docs/recording.md). `mkctl log repair
    --viewer` adds it later.

    True delays setpoints."""
    images: RecordedImages = RecordedImages()
    """Images of the cameras."""

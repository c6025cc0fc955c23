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
    """A file is ended and the next one begun at this size [MB].

    Smaller makes many files."""
    file_minutes: Annotated[float, RELOADABLE] = Field(default=30.0, gt=0.0)
    """The same at this age [min].

    Shorter makes many files."""
    total_mb: Annotated[int, RELOADABLE] = Field(default=4000, ge=1)
    """Largest size of all recordings of this vehicle in the folder [MB].

    Smaller deletes old flights sooner."""
    free_mb: Annotated[int, RELOADABLE] = Field(default=1000, ge=1)
    """Space of the disk that stays free for other programs [MB].

    Smaller lets recordings fill the disk of the system."""
    delete_oldest: Annotated[bool, RELOADABLE] = True
    """Delete this vehicle's oldest recordings to stay within `total_mb` and `free_mb`; else recording stops there.

    False stops recording when the room is used up."""
    sync_s: float = Field(default=5.0, ge=0.0)
    """Time between two moments at which everything is brought to the disk itself, so that it survives a power failure
    [s]; 0: when the system does. What a killed daemon wrote survives in any case.

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

"""Configuration of the daemon's own recorder."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mkdaemon.config.base import Section


class RecordedImages(Section):
    """Which images of the cameras are recorded."""

    hz: float = Field(default=2.0, ge=0.0, le=120.0)
    """Images a second and camera; 0 for none. A replay through the eyes needs every image, as `png`."""
    coding: Literal["jpeg", "png"] = "jpeg"
    """`jpeg` is small, `png` is exact and takes five times the room."""
    jpeg_quality: int = Field(default=80, ge=1, le=100)
    """100 is the best."""


class RecordConfig(Section):
    """The black box: what the daemon publishes, receives and decides, in files."""

    enabled: bool = True
    """Record whenever the daemon runs; a recording that plays is not recorded again."""
    folder: Path | None = None
    """Where; unset: `recordings` in the folder of `vehicle.state_folder`."""
    file_mb: int = Field(default=200, ge=1)
    """A file is ended and the next one begun at this size [MB]."""
    file_minutes: float = Field(default=30.0, gt=0.0)
    """The same at this age [min]."""
    total_mb: int = Field(default=4000, ge=1)
    """All recordings of this vehicle in the folder may take so much [MB]."""
    free_mb: int = Field(default=1000, ge=1)
    """So much of the disk is left free for others [MB]."""
    delete_oldest: bool = True
    """Delete this vehicle's oldest recordings to stay within `total_mb` and `free_mb`; else recording stops there."""
    sync_s: float = Field(default=5.0, ge=0.0)
    """Time between two moments at which everything is brought to the disk itself, so that it survives a power failure
    [s]; 0: when the system does. What a killed daemon wrote survives in any case."""
    queue_mb: int = Field(default=32, ge=1, le=1024)
    """So much may wait in memory for a slow disk; beyond it entries are lost and counted [MB]."""
    json_for_viewers: bool = False
    """Add JSON for viewers; it takes twice the room and delays setpoints (docs/recording.md). `mkctl log recover
    --viewer` adds it later."""
    images: RecordedImages = RecordedImages()
    """Images of the cameras."""

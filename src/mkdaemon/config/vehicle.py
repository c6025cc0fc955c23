"""Which aircraft this daemon speaks for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from mkdaemon.config.base import RELOADABLE, Section
from mkdaemon.config.names import VEHICLE_NAME


class VehicleConfig(Section):
    """Identity of the aircraft."""

    name: str = Field(default="mk1", pattern=VEHICLE_NAME)
    """Name in every key, `mk/<name>/...`: lower-case letters, digits, `-` and `_`.

    Two aircraft of one name on one bus obey the same commands. A client finds another name with `--vehicle`."""
    battery_cells: int | None = Field(default=None, ge=1, le=14)
    """Cells of the battery in series; unset: as many as its voltage shows, or as were remembered from earlier flights.

    A number that is too low lets a battery be flown until it is damaged; one that is too high warns of a full one."""
    state_folder: Path | None = None
    """Folder of what must survive a restart, for example which parameter set has to be live; unset: systemd's
    `$STATE_DIRECTORY/<name>`, else `$XDG_STATE_HOME/mkdaemon/<name>`, else `~/.local/state/mkdaemon/<name>`.

    In a folder that does not survive, a sudden end leaves the aircraft with a parameter set that is not restored."""
    note: Annotated[str, RELOADABLE] = Field(default="", max_length=200)
    """Free text shown by `mkctl status`, for example airframe and battery.

    It changes nothing else."""

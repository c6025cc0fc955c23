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

    Two aircraft with the same name on one bus obey the same commands. Clients select a name with `--vehicle`."""
    battery_cells: int | None = Field(default=None, ge=1, le=14)
    """Battery cells in series; unset: derived from the voltage, or stored from earlier flights.

    If too low, the low-battery alarm comes too late and the battery is damaged; if too high, it warns of a full one."""
    state_folder: Path | None = None
    """Folder of the state that must survive a restart, for example the live parameter set; unset: systemd's
    `$STATE_DIRECTORY/<name>`, else `$XDG_STATE_HOME/mkdaemon/<name>`, else `~/.local/state/mkdaemon/<name>`.

    If the folder does not survive a restart, a crash can leave the wrong parameter set on the aircraft."""
    note: Annotated[str, RELOADABLE] = Field(default="", max_length=200)
    """Free text shown by `mkctl status`, for example airframe and battery.

    No other effect."""

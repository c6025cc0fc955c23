"""The active set of the FlightCtrl as parameters of the gateway's node: `settings.gyro_p`.

They are declared when they are read, and a new value is written as `mkctl settings write` writes it; MAVROS does the
same with the parameters of its autopilot. Before the first write the set is saved.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any, Final

from mkdaemon.client import Vehicle
from mkdaemon.client.settings_files import write_backup
from mkdaemon.errors import MkError
from mkdaemon.files import user_folder
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_fields import Kind
from mkdaemon.telemetry.settings import SettingsBackup

PREFIX: Final = "settings."
Declare = Callable[[str, Any, str], None]
"""Declares a parameter, or gives it a value that was read: name, value, what it is."""


class BoardSettings:
    """Reads and writes the active set."""

    def __init__(self, uav: Vehicle, declare: Declare) -> None:
        """Have read nothing yet.

        Args:
            uav: the vehicle.
            declare: makes parameters.
        """
        self._uav, self._declare = uav, declare
        self._found: SettingsBackup | None = None
        self._is_saved = False

    async def pull(self) -> int:
        """Read the active set; how many parameters it has.

        Raises:
            MkError: it cannot be read, or its layout is not known.
        """
        return self._show(await self._uav.settings.backup(()))

    def _show(self, found: SettingsBackup) -> int:
        self._found = found
        raw = next((one.raw for one in found.sets if one.slot == found.active), b"")
        stored = ParameterSet.from_payload(raw)
        if stored is None or stored.layout is None:
            raise MkError("the layout of these settings is not known: `mkctl settings show`")
        shown = 0
        for name, place in stored.layout.places.items():
            parameter = place.parameter
            if parameter.kind not in (Kind.TEXT, Kind.SPARE) and name != "revision":
                value = stored[name]
                about = f"{parameter.meaning}{f' [{parameter.unit}]' if parameter.unit else ''}"
                self._declare(f"{PREFIX}{name}", list(value) if isinstance(value, tuple) else value, about)
                shown += 1
        return shown

    async def write(self, name: str, value: Any) -> None:
        """Write one setting of the set that was read.

        Args:
            name: of the parameter.
            value: what it is to be.

        Raises:
            MkError: the daemon refuses, or it is not proven.
        """
        found = self._found
        if found is None:
            raise MkError("the settings have not been read: call param/pull")
        if not self._is_saved:
            stamp = datetime.datetime.now(tz=datetime.UTC).strftime("%Y%m%dT%H%M%S")
            folder = user_folder("XDG_STATE_HOME") / "gateway-ros2"
            write_backup(folder / f"before-{stamp}.toml", found, (found.active,))
            self._is_saved = True
        plain = value if isinstance(value, int) else list(value)
        await self._uav.settings.write({name.removeprefix(PREFIX): plain}, confirm=True, slot=found.active)

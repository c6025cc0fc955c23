"""The active set of the FlightCtrl as parameters of the gateway's node: `settings.gyro_p`.

They are declared when they are read, and a new value is written as `mkctl settings write` writes it; MAVROS does the
same with the parameters of its autopilot. Before the first write the set is saved.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.gateways.boardset import GatewaySettings, backups_folder, numbers_of

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
        self._set, self._declare = GatewaySettings(uav, partial(backups_folder, "ros2")), declare

    async def pull(self) -> int:
        """Read the active set; how many parameters it has.

        Raises:
            MkError: it cannot be read, or its layout is not known.
        """
        await self._set.read()
        stored = self._set.stored
        if stored is None or stored.layout is None:
            raise MkError("the layout of these settings is not known: `mkctl settings show`")
        shown = 0
        for name, parameter, _ in numbers_of(stored.layout):
            if name != "revision":
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
        if not self._set.slot:
            raise MkError("the settings have not been read: call param/pull")
        await self._set.write(name.removeprefix(PREFIX), value if isinstance(value, int) else tuple(value))

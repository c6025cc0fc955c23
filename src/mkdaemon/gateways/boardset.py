"""The active parameter set of the FlightCtrl as gateways show it: read whole, written by setting, saved before."""

from __future__ import annotations

import datetime
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from mkdaemon.client import Vehicle
from mkdaemon.client.settings_files import write_backup
from mkdaemon.errors import MkError
from mkdaemon.files import user_folder
from mkdaemon.protocol.settings import Layout, ParameterSet, Value
from mkdaemon.protocol.settings_fields import ParameterKind, SettingParameter
from mkdaemon.telemetry.procedure import ProcedureProgress, ProcedureState
from mkdaemon.telemetry.settings import SettingsBackup

STORED: Final = 1
"""Step of the progress of a write of one set: the board has stored it, and it is read back."""


def backups_folder(gateway: str) -> Path:
    """Folder of what a gateway keeps, unless it is given another one: systemd's state directory, else the user's.

    Raises:
        ConfigError: the account has no home folder.
    """
    given = os.environ.get("STATE_DIRECTORY")
    if given:
        return Path(given.partition(":")[0])
    return user_folder("XDG_STATE_HOME") / f"gateway-{gateway}"


def numbers_of(layout: Layout) -> Iterator[tuple[str, SettingParameter, int | None]]:
    """The settings of a layout that are numbers, or lists of them, in wire order.

    Yields:
        Name, meaning, and length of a list; None for one number. Texts and spare bytes are left out.
    """
    for name, place in layout.places.items():
        kind = place.parameter.kind
        if kind not in {ParameterKind.TEXT, ParameterKind.SPARE}:
            yield name, place.parameter, place.length if kind is ParameterKind.LIST else None


class GatewaySettings:
    """Reads and writes the active set.

    Attributes:
        slot: its number; 0 before it has been read.
        stored: as it was last read or written; None before that, and where its layout is unknown.
    """

    def __init__(self, uav: Vehicle, backups: Callable[[], Path]) -> None:
        """Have read nothing yet.

        Args:
            uav: the vehicle.
            backups: folder in which the set is saved before the first write.
        """
        self.slot = 0
        self.stored: ParameterSet | None = None
        self._uav, self._backups = uav, backups
        self._found: SettingsBackup | None = None
        self._is_saved = False

    async def read(self) -> None:
        """Read it.

        Raises:
            MkError: the daemon refuses, or does not answer.
        """
        self._keep(await self._uav.settings.backup(()))

    def _keep(self, found: SettingsBackup) -> None:
        self._found, self.slot = found, found.active
        raw = next((one.raw for one in found.sets if one.slot == found.active), b"")
        stored = ParameterSet.from_payload(raw)
        self.stored = stored if stored is not None and stored.layout is not None else None

    async def write(self, setting: str, value: Value, on_stored: Callable[[], None] = lambda: None) -> None:
        """Write a setting, and keep what was read back.

        Args:
            setting: its name.
            value: what it is to be.
            on_stored: called when the board has answered that it has stored the set, before it is read back.

        Raises:
            MkError: it has not been read, cannot be saved, or the daemon refuses.
        """
        found = self._found
        if self.stored is None or found is None:
            raise MkError("the settings have not been read")
        if not self._is_saved:
            stamp = datetime.datetime.now(tz=datetime.UTC).strftime("%Y%m%dT%H%M%S")
            # A small file, once, with the motors off: nothing is flown that would wait for it.
            write_backup(self._backups() / f"before-{stamp}.toml", found, (found.active,))
            self._is_saved = True

        def follow(progress: ProcedureProgress) -> None:
            if progress.state is ProcedureState.RUNNING and progress.step == STORED:
                on_stored()

        plain = list(value) if isinstance(value, tuple) else value
        made = await self._uav.settings.write({setting: plain}, confirm=True, slot=found.active, on_progress=follow)
        written = {one.slot: one for one in made.stored}
        sets = tuple(written.get(one.slot, one) for one in found.sets)
        self._keep(found.model_copy(update={"active": made.active, "sets": sets}))

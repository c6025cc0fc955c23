"""Parameter sets of the FlightCtrl, and their backups in files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mkdaemon.client.asking import OnProgress
from mkdaemon.client.verbcalls import SettingsVerbs

if TYPE_CHECKING:
    from mkdaemon.telemetry.settings import SettingsComparison, SettingsRestoration

ALL_SLOTS: Final = (1, 2, 3, 4, 5)


class VehicleSettings(SettingsVerbs):
    """Parameter sets: read, compare, change and restore. The motors must be off, and no client may hold the lease."""

    async def backup_to(
        self,
        path: Path,
        slots: Sequence[int] = ALL_SLOTS,
        *,
        overwrite: bool = False,
        on_progress: OnProgress | None = None,
    ) -> tuple[Path, ...]:
        """Save parameter sets to files; the live set is byte-identical afterwards, proven by reading it again.

        Args:
            path: a folder for one file a set, or one `.toml` or `.json` file for a single set; with no set named, the
                active one.
            slots: numbers of the sets.
            overwrite: replace files that are there.
            on_progress: called with every step.

        Returns:
            The files.

        Raises:
            ConfigError: a file is there already, or several sets were to go into one; nothing was asked.
            CommandRejectedError: as `backup`.
            MkError: a file cannot be written, or no daemon speaks for this vehicle.
        """
        from mkdaemon.client.settings_files import check_target, write_backup

        wanted = check_target(path, slots, overwrite=overwrite)
        found = await self.backup(wanted, on_progress=on_progress)
        return write_backup(path, found, wanted or (found.active,), overwrite=overwrite)

    async def compare_with(self, path: Path, *, on_progress: OnProgress | None = None) -> SettingsComparison:
        """Compare a backup with the sets of the FlightCtrl; writes nothing.

        Args:
            path: file or folder of the backup.
            on_progress: called with every step.

        Raises:
            ConfigError: the files hold no sets.
            CommandRejectedError: as `compare`.
            MkError: no daemon serves this vehicle.
        """
        from mkdaemon.client.settings_files import stored_sets

        return await self.compare(stored_sets(path), on_progress=on_progress)

    async def restore_from(
        self, path: Path, *, confirm: bool = False, dry_run: bool = False, on_progress: OnProgress | None = None
    ) -> SettingsRestoration:
        """Write the sets of a backup that differ, and read them back; the set that is active stays active.

        Args:
            path: file or folder of the backup.
            confirm: must be true: what is written decides how the aircraft flies.
            dry_run: read and compare only; needs no `confirm`.
            on_progress: called with every step.

        Raises:
            ConfigError: the files hold no sets.
            CommandRejectedError: refused (another revision, another length), or not proven: do not fly then.
            MkError: no daemon serves this vehicle.
        """
        from mkdaemon.client.settings_files import stored_sets

        return await self.restore(stored_sets(path), confirm=confirm, dry_run=dry_run, on_progress=on_progress)

"""Parameter sets, mixer and motor controllers of the FlightCtrl: read, saved, compared, changed and restored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mkdaemon.client.procedures import OnProgress, Procedures

if TYPE_CHECKING:
    from mkdaemon.telemetry.settings import (
        ControllerSettings,
        MixerTable,
        OwedSet,
        SettingsBackup,
        SettingsComparison,
        SettingsRestoration,
    )

ALL_SLOTS = (1, 2, 3, 4, 5)


class SettingsProcedures(Procedures):
    """Asks for procedures with the FlightCtrl's settings. Motors must stand still, and nobody may hold the lease."""

    async def read_settings(
        self, slots: Sequence[int] = ALL_SLOTS, *, on_progress: OnProgress | None = None
    ) -> SettingsBackup:
        """Read parameter sets; the active one is live again afterwards, proven by comparing bytes.

        Args:
            slots: numbers of the sets; the active one is read in any case.
            on_progress: called with every step.

        Raises:
            CommandRejectedError: refused, or the live set could not be proven: do not fly then.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import SettingsBackup

        return await self.run_procedure(
            "settings_backup", SettingsBackup, {"slots": list(slots)}, on_progress=on_progress
        )

    async def backup_settings(
        self,
        path: Path,
        slots: Sequence[int] = ALL_SLOTS,
        *,
        overwrite: bool = False,
        on_progress: OnProgress | None = None,
    ) -> tuple[Path, ...]:
        """Save parameter sets to files.

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
            CommandRejectedError: as `read_settings`.
            MkError: a file cannot be written, or no daemon speaks for this vehicle.
        """
        from mkdaemon.client.settings_files import check_target, write_backup

        wanted = check_target(path, slots, overwrite=overwrite)
        found = await self.read_settings(wanted, on_progress=on_progress)
        return write_backup(path, found, wanted or (found.active,), overwrite=overwrite)

    async def compare_settings(
        self, source: Path | Mapping[int, bytes], *, on_progress: OnProgress | None = None
    ) -> SettingsComparison:
        """Compare parameter sets with those of the FlightCtrl; writes nothing.

        Args:
            source: file or folder of a backup, or bytes by number.
            on_progress: called with every step.

        Raises:
            ConfigError: the files hold no sets.
            CommandRejectedError: as `read_settings`.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import SettingsComparison

        fields = {"sets": _sets_of(source)}
        return await self.run_procedure("settings_compare", SettingsComparison, fields, on_progress=on_progress)

    async def restore_settings(
        self, source: Path | Mapping[int, bytes], *, dry_run: bool = False, on_progress: OnProgress | None = None
    ) -> SettingsRestoration:
        """Write the parameter sets that differ, and read them back; the set that is active stays active.

        Args:
            source: file or folder of a backup, or bytes by number.
            dry_run: read and compare only.
            on_progress: called with every step.

        Raises:
            ConfigError: the files hold no sets.
            CommandRejectedError: refused (another revision, another length), or not proven: do not fly then.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import SettingsRestoration

        fields = {"sets": _sets_of(source), "confirm": True, "dry_run": dry_run}
        return await self.run_procedure("settings_restore", SettingsRestoration, fields, on_progress=on_progress)

    async def write_settings(
        self,
        values: Mapping[str, int | str | list[int] | list[str]],
        slot: int | None = None,
        *,
        dry_run: bool = False,
        on_progress: OnProgress | None = None,
    ) -> SettingsRestoration:
        """Change parameters of one set by name, and read it back.

        Args:
            values: new values by name; potis as `poti1`, bits as a list of names.
            slot: number of the set; the active one without.
            dry_run: read and compare only.
            on_progress: called with every step.

        Raises:
            CommandRejectedError: `bad_value`, or as `restore_settings`.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import SettingsRestoration

        fields = {"values": dict(values), "slot": slot, "confirm": True, "dry_run": dry_run}
        return await self.run_procedure("settings_write", SettingsRestoration, fields, on_progress=on_progress)

    async def recover_settings(self, action: Literal["show", "retry", "discard"] = "show") -> tuple[OwedSet, ...]:
        """Look after live sets that a procedure left unproven; the daemon restores them by itself when it can.

        Args:
            action: `show` them, `retry` at once, or `discard` the notes, because you know what is live.

        Raises:
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import OwedSets

        fields = {"action": action, "confirm": action == "discard"}
        return (await self.run_procedure("settings_recover", OwedSets, fields)).notes

    async def mixer(self) -> MixerTable:
        """Read the mixer.

        Raises:
            CommandRejectedError: the FlightCtrl cannot be reached or did not answer.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import MixerTable

        return await self.run_procedure("mixer_read", MixerTable)

    async def write_mixer(self, name: str, motors: Sequence[int], *, confirm: bool = False) -> MixerTable:
        """Store a mixer, read it back and compare; the FlightCtrl uses it at once.

        Args:
            name: at most twelve ASCII characters.
            motors: 16 rows of throttle, pitch, roll, yaw; 64 is 100 %.
            confirm: you know that a wrong mixer flips the aircraft.

        Raises:
            CommandRejectedError: refused, or the FlightCtrl holds another mixer: do not fly then.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import MixerTable

        fields = {"name": name, "motors": list(motors), "confirm": confirm}
        return await self.run_procedure("mixer_write", MixerTable, fields)

    async def motor_controllers(self, motors: Sequence[int]) -> tuple[ControllerSettings, ...]:
        """Read the configuration of motor controllers.

        Args:
            motors: which, 1..16.

        Raises:
            CommandRejectedError: refused, or a controller did not answer.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import MotorControllers

        found = await self.run_procedure("motor_controllers_read", MotorControllers, {"motors": list(motors)})
        return found.controllers

    async def change_motor_controller(self, motor: int, *, confirm: bool = False, **items: Any) -> ControllerSettings:
        """Change some items of a motor controller, read them back and compare.

        Args:
            motor: which, 1..16.
            confirm: you know that a wrong sense of rotation or limit crashes the aircraft.
            items: fields of `MotorControllersWriteRequest`; what is absent stays as it is.

        Raises:
            CommandRejectedError: refused, or the controller holds something else: do not fly then.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.settings import MotorControllers

        fields = {"motor": motor, "confirm": confirm, **items}
        return (await self.run_procedure("motor_controllers_write", MotorControllers, fields)).controllers[0]


def _sets_of(source: Path | Mapping[int, bytes]) -> list[dict[str, Any]]:
    from mkdaemon.client.settings_files import read_sets

    sets = source
    if isinstance(source, Path):
        sets = {slot: one.parameters.raw for slot, one in read_sets(source).items()}
    assert not isinstance(sets, Path)
    return [{"slot": slot, "raw": raw} for slot, raw in sets.items()]

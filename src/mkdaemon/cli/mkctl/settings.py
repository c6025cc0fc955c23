"""`mkctl settings`: the FlightCtrl's parameter sets by name, as files, and back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.progress import showing_progress
from mkdaemon.cli.printing import json_line
from mkdaemon.client.settings import ALL_SLOTS
from mkdaemon.client.settings_files import SetSource, check_target, read_sets, write_backup
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import Spelled, SpelledChange, change_by_name, spell_changes, spell_value
from mkdaemon.telemetry.refusals import Token
from mkdaemon.telemetry.settings import SettingsBackup, SettingsRestoration, StoredSet

app = App(
    name="settings",
    help="Parameter sets of the FlightCtrl. Reading a set loads it, so motors must be off; the active set is loaded "
    "again at the end and proven by comparing bytes.",
)

Slot = Annotated[Literal[1, 2, 3, 4, 5] | None, Parameter(help="Set 1..5; default: the active one.")]
Names = Annotated[str, Parameter(help="Parameters to show; default: all.")]
Changes = Annotated[str, Parameter(help="NAME=VALUE; potis as `poti1`, bits as `name,name`.")]
Saved = Annotated[Path, Parameter(help="File or folder of a backup.")]
Other = Annotated[Path | None, Parameter(help="A second backup; default: the board.")]
Target = Annotated[Path, Parameter(help="A folder for all five sets, or one `.toml` or `.json` file for one.")]
DryRun = Annotated[bool, Parameter(help="Read and compare only.")]
Force = Annotated[bool, Parameter(help="Overwrite existing files.")]


@app.command(name="list")
async def list_sets(*, connection: Connection = HERE) -> None:
    """Show number, name and revision of all five sets, and which one is active.

    Example: mkctl settings list
    """
    backup = await _read(connection, ALL_SLOTS)
    rows = [
        {"slot": slot, "name": found.name, "revision": found.revision, "active": slot == backup.active}
        for slot, found in _sets(backup.sets).items()
    ]
    lines = (f"{'* '[not row['active']]} {row['slot']}  {row['name']:12}  revision {row['revision']}" for row in rows)
    connection.show(rows, "\n".join(lines))


@app.command
async def show(*names: Names, slot: Slot = None, connection: Connection = HERE) -> None:
    """Show a set's parameters by name: value, unit, meaning.

    Example: mkctl settings show gyro_p external_control
    """
    backup = await _read(connection, (slot,) if slot else ())
    number = slot or backup.active
    found = _sets(backup.sets)[number]
    if found.layout is None:
        print(f"# {found.reason}")
        print(found.raw.hex())
        return
    values = {name: spell_value(found, name) for name in names or found.values()}
    lines = [f"# set {number} {found.name!r}, revision {found.revision}, FlightCtrl {backup.firmware}"]
    for name, value in values.items():
        parameter = found.layout.place(name).parameter
        unit = f" {parameter.unit}" if parameter.unit else ""
        lines.append(f"{name:32} {_spell(value)}{unit:12}  {parameter.meaning}")
    connection.show({"slot": number, "revision": found.revision, "values": values}, "\n".join(lines))


@app.command
async def backup(target: Target, /, *, slot: Slot = None, force: Force = False, connection: Connection = HERE) -> None:
    """Save sets to files; the live set is byte-identical afterwards, proven by reading it again.

    Example: mkctl settings backup before/
    """
    slots = check_target(target, (slot,) if slot else ALL_SLOTS, overwrite=force)
    found = await _read(connection, slots)
    paths = write_backup(target, found, slots or (found.active,), overwrite=force)
    files = [str(path) for path in paths]
    words = f"saved {', '.join(files)}; set {found.active} is live, byte for byte as before"
    connection.show({"active": found.active, "files": files}, words)


@app.command
async def compare(first: Saved, second: Other = None, /, *, connection: Connection = HERE) -> int:
    """Show what differs between two backups, or between a backup and the board. Exit code 1 where they differ.

    Example: mkctl settings compare before/ after/
    """
    before = read_sets(first)
    if second is not None:
        after = {slot: source.parameters for slot, source in read_sets(second).items()}
        if before.keys() != after.keys() and len(before) == len(after) == 1:
            after = dict(zip(before, after.values(), strict=True))
    else:
        async with connection.open() as uav, showing_progress(uav, "read", quiet=connection.json) as report:
            after = _sets((await uav.settings.compare(_raw(before), on_progress=report)).stored)
    changes = {slot: spell_changes(source.parameters, after[slot]) for slot, source in before.items() if slot in after}
    _print_changes(connection, changes, "{name} is {before} in the first and {after} in the second")
    return 1 if any(changes.values()) else 0


@app.command
async def restore(
    source: Saved, /, *, slot: Slot = None, dry_run: DryRun = False, connection: Connection = HERE
) -> None:
    """Write sets from files and read them back; the set that is active stays active.

    Refused with motors running, for another revision or length, and for revisions this version does not know.

    Example: mkctl settings restore before/ --dry-run

    Raises:
        ConfigError: the files hold no sets, or several where `--slot` moves one.
        MkError: the FlightCtrl refused a set, or holds another one afterwards.
    """
    sets = read_sets(source)
    if slot is not None:
        if len(sets) != 1:
            raise ConfigError(f"{source}: --slot moves a single set, this holds {len(sets)}; name one file")
        sets = {slot: next(iter(sets.values()))}
    for source_set in sets.values():
        if source_set.parameters.layout is None:
            msg = f"{source_set.name}: {source_set.parameters.reason}; such sets are a record and never written"
            raise ConfigError(msg)
    async with connection.open() as uav, showing_progress(uav, "write", quiet=connection.json) as report:
        done = await uav.settings.restore(_raw(sets), confirm=True, dry_run=dry_run, on_progress=report)
    _print_written(connection, {slot: found.parameters for slot, found in sets.items()}, done, dry_run=dry_run)


@app.command
async def write(*changes: Changes, slot: Slot = None, dry_run: DryRun = False, connection: Connection = HERE) -> None:
    """Change parameters of one set by name, for example `write gyro_p=85 external_control=poti1`.

    Example: mkctl settings write external_control=poti1 --dry-run

    Raises:
        ConfigError: nothing to change, or no such parameter or value.
        MkError: the FlightCtrl refused it, or holds another set afterwards.
    """
    wanted = dict(_split(change) for change in changes)
    if not wanted:
        msg = "nothing to change; write NAME=VALUE, for example gyro_p=85 (`mkctl settings show` lists names)"
        raise ConfigError(msg)
    async with connection.open() as uav, showing_progress(uav, "write", quiet=connection.json) as report:
        try:
            done = await uav.settings.write(wanted, slot=slot, confirm=True, dry_run=dry_run, on_progress=report)
        except CommandRejectedError as error:
            if error.token != Token.BAD_VALUE:
                raise
            raise ConfigError(f"{error.reason} {error.fix}") from error
    [(number, before)] = _sets(done.before).items()
    changed = change_by_name(before, wanted)
    if changed.raw == before.raw:
        print("nothing to change")
        return
    _print_written(connection, {number: changed}, done, dry_run=dry_run)


@app.command
async def recover(
    *,
    retry: Annotated[bool, Parameter(help="Retry now.")] = False,
    discard: Annotated[bool, Parameter(help="Discard the note: you know which set is live.")] = False,
    connection: Connection = HERE,
) -> int:
    """Show live sets that a procedure left unproven; the daemon restores them when it can. Exit code 1 if any is owed.

    Example: mkctl settings recover --retry

    Raises:
        ConfigError: both at once.
    """
    if retry and discard:
        raise ConfigError("--retry and --discard exclude each other")
    async with connection.open() as uav:
        action: Literal["show", "retry", "discard"] = "discard" if discard else "retry" if retry else "show"
        notes = (await uav.settings.recover(action=action, confirm=discard)).notes
    lines = (
        f"set {note.active} of a FlightCtrl {note.firmware}, live when {note.verb} was cut off: {note.detail}"
        for note in notes
    )
    connection.show([note.model_dump() for note in notes], "\n".join(lines) or "no live set is owed")
    return 1 if any(note.is_owed for note in notes) else 0


async def _read(connection: Connection, slots: tuple[int, ...]) -> SettingsBackup:
    async with connection.open() as uav, showing_progress(uav, "read", quiet=connection.json) as report:
        return await uav.settings.backup(slots, on_progress=report)


def _print_written(
    connection: Connection, wanted: dict[int, ParameterSet], done: SettingsRestoration, *, dry_run: bool
) -> None:
    """Say what would change or was changed, and what the FlightCtrl made of it."""
    before = _sets(done.before)
    planned = {slot: spell_changes(before[slot], parameters) for slot, parameters in wanted.items()}
    if dry_run:
        _print_changes(connection, planned, "would change {name} from {before} to {after}")
        return
    stored = _sets(done.stored)
    of_fc = {slot: spell_changes(parameters, stored[slot]) for slot, parameters in wanted.items()}
    if connection.json:
        print(json_line({"written": done.written, "active": done.active, "changed_by_fc": _plain(of_fc)}))
        return
    _print_changes(connection, planned, "{name}: {before} -> {after}")
    _print_changes(connection, of_fc, "the FC changed {name} from {before} to {after}", silent=True)
    print(f"set {done.active} is active and live" if done.written else "nothing had to be written")


def _print_changes(
    connection: Connection, changes: dict[int, tuple[SpelledChange, ...]], form: str, *, silent: bool = False
) -> None:
    lines = [
        f"set {slot}: " + form.format(name=change.name, before=_spell(change[1]), after=_spell(change[2]))
        for slot, found in changes.items()
        for change in found
    ]
    if lines or connection.json or not silent:
        connection.show(_plain(changes), "\n".join(lines) or "no difference")


def _plain(changes: dict[int, tuple[SpelledChange, ...]]) -> dict[int, list[dict[str, Spelled | None]]]:
    return {slot: [change._asdict() for change in found] for slot, found in changes.items()}


def _sets(found: tuple[StoredSet, ...]) -> dict[int, ParameterSet]:
    return {one.slot: ParameterSet.from_payload(one.raw) for one in found}


def _raw(sets: dict[int, SetSource]) -> list[StoredSet]:
    return [StoredSet(slot=slot, raw=source.parameters.raw) for slot, source in sets.items()]


def _split(change: str) -> tuple[str, str]:
    name, equals, value = change.partition("=")
    if not equals or not name:
        raise ConfigError(f"{change!r} is not a change; write NAME=VALUE, for example gyro_p=85")
    return name.strip().replace("-", "_"), value.strip()


def _spell(value: object) -> str:
    if value is None:
        return "absent"
    return ",".join(str(part) for part in value) or "none" if isinstance(value, list) else str(value)

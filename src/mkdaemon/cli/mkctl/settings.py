"""`mkctl settings`: the FlightCtrl's parameter sets by name, as files, and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Final, Literal

from cyclopts import App, Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.conversation import converse, progress_bar
from mkdaemon.cli.mkctl.settings_files import Source, read_sets, read_target, write_backup
from mkdaemon.errors import ConfigError, ProtocolError
from mkdaemon.protocol.procedures.live_set import SLOTS
from mkdaemon.protocol.procedures.settings import Backup, Restoration, backup_settings, restore_settings
from mkdaemon.protocol.procedures.steps import Patience
from mkdaemon.protocol.settings import ParameterSet, Value, is_useful
from mkdaemon.protocol.settings_file import Spelled, SpelledChange, parse_value, spell_changes, spell_value

app = App(
    name="settings",
    help="Parameter sets of the FlightCtrl. Reading a set loads it, so motors must be off; the active set is loaded "
    "again at the end and proven by comparing bytes.",
)

PATIENCE: Final = Patience(attempts=6)

Slot = Annotated[Literal[1, 2, 3, 4, 5] | None, Parameter(help="Set 1..5; without it the active one.")]
Names = Annotated[str, Parameter(help="Parameters to show; all without any.")]
Changes = Annotated[str, Parameter(help="NAME=VALUE; potis as `poti1`, bits as `name,name`.")]
Saved = Annotated[Path, Parameter(help="File or folder of a backup.")]
Other = Annotated[Path | None, Parameter(help="Another; without it the board is read.")]
Target = Annotated[Path, Parameter(help="A folder for all five sets, or one `.toml` or `.json` file for one.")]
DryRun = Annotated[bool, Parameter(negative=(), help="Read and compare only.")]


@app.command(name="list")
async def list_sets(*, connection: Connection = HERE) -> None:
    """Show number, name and revision of all five sets, and which one is active."""
    backup = await _read(connection, SLOTS)
    rows = [
        {"slot": slot, "name": found.name, "revision": found.revision, "active": slot == backup.active}
        for slot, found in _sets(backup).items()
    ]
    if connection.json:
        print(json.dumps(rows))
        return
    for row in rows:
        print(f"{'*' if row['active'] else ' '} {row['slot']}  {row['name']:12}  revision {row['revision']}")


@app.command
async def show(*names: Names, slot: Slot = None, connection: Connection = HERE) -> None:
    """Show a set's parameters by name: value, unit, meaning."""
    backup = await _read(connection, (slot,) if slot else ())
    number = slot or backup.active
    found = _sets(backup)[number]
    if found.layout is None:
        print(f"# {found.reason}")
        print(found.raw.hex())
        return
    values = {name: spell_value(found, name) for name in names or found.values()}
    if connection.json:
        print(json.dumps({"slot": number, "revision": found.revision, "values": values}))
        return
    print(f"# set {number} {found.name!r}, revision {found.revision}, FlightCtrl {backup.version.release}")
    for name, value in values.items():
        parameter = found.layout.place(name).parameter
        unit = f" {parameter.unit}" if parameter.unit else ""
        print(f"{name:32} {_spell(value)}{unit:12}  {parameter.meaning}")


@app.command
async def backup(target: Target, /, *, slot: Slot = None, connection: Connection = HERE) -> None:
    """Save sets to files; the live set is byte-identical afterwards, proven by reading it again."""
    is_file = read_target(target)
    slots = ((slot,) if slot else ()) if is_file or slot else SLOTS
    found = await _read(connection, slots)
    wanted = {slot or found.active} if is_file or slot else set(SLOTS)
    paths = write_backup(target, found, wanted)
    if connection.json:
        print(json.dumps({"active": found.active, "files": [str(path) for path in paths]}))
        return
    print(f"saved {', '.join(str(path) for path in paths)}; set {found.active} is live, byte for byte as before")


@app.command
async def diff(first: Saved, second: Other = None, /, *, connection: Connection = HERE) -> int:
    """Show what differs between two backups, or between a backup and the board. Exit code 1 where they differ."""
    before = read_sets(first)
    if second is not None:
        after = {slot: source.parameters for slot, source in read_sets(second).items()}
    else:
        after = _sets(await _read(connection, tuple(before)))
    if before.keys() != after.keys() and len(before) == len(after) == 1:
        after = dict(zip(before, after.values(), strict=True))
    changes = {slot: spell_changes(source.parameters, after[slot]) for slot, source in before.items() if slot in after}
    _print_changes(connection, changes, "{name} is {before} in the first and {after} in the second")
    return 1 if any(changes.values()) else 0


@app.command
async def restore(
    source: Saved, /, *, slot: Slot = None, dry_run: DryRun = False, connection: Connection = HERE
) -> None:
    """Write sets from files and read them back; the set that is active stays active.

    Refused with motors running, for another revision or length, and for revisions this version does not know.

    Raises:
        ConfigError: the files hold no sets, or several where `--slot` moves one.
        MkError: the FlightCtrl refused a set, or holds another one afterwards.
    """
    sets = read_sets(source)
    if slot is not None:
        if len(sets) != 1:
            msg = f"{source}: --slot moves a single set, this holds {len(sets)}; name one file"
            raise ConfigError(msg)
        sets = {slot: next(iter(sets.values()))}
    await _write(connection, sets, dry_run=dry_run)


@app.command
async def edit(*changes: Changes, slot: Slot = None, dry_run: DryRun = False, connection: Connection = HERE) -> None:
    """Change parameters of one set by name, for example `edit gyro_p=85 external_control=poti1`.

    Raises:
        ConfigError: nothing to change, or no such parameter or value.
        MkError: the FlightCtrl refused it, or holds another set afterwards.
    """
    wanted = dict(_split(change) for change in changes)
    if not wanted:
        msg = "nothing to change; write NAME=VALUE, for example gyro_p=85 (`mkctl settings show` lists names)"
        raise ConfigError(msg)
    found = await _read(connection, (slot,) if slot else ())
    number = slot or found.active
    current = _sets(found)[number]
    changed = _change(current, wanted)
    if changed.raw == current.raw:
        print("nothing to change")
        return
    await _write(connection, {number: Source(changed, f"set {number}")}, dry_run=dry_run)


async def _read(connection: Connection, slots: tuple[int, ...]) -> Backup:
    async with connection.open() as client:
        with progress_bar("read", quiet=connection.json) as report:
            return await converse(client, backup_settings(PATIENCE, slots), report)


async def _write(connection: Connection, sets: dict[int, Source], *, dry_run: bool) -> None:
    for source in sets.values():
        if source.parameters.layout is None:
            msg = f"{source.name}: {source.parameters.reason}; such sets are kept as a record and never written"
            raise ConfigError(msg)
    wanted = {slot: source.parameters.raw for slot, source in sets.items()}
    async with connection.open() as client:
        with progress_bar("write", quiet=connection.json) as report:
            done = await converse(client, restore_settings(wanted, PATIENCE, dry_run=dry_run), report)
    _tell(connection, sets, done, dry_run=dry_run)


def _tell(connection: Connection, sets: dict[int, Source], done: Restoration, *, dry_run: bool) -> None:
    """Say what would change or was changed, and what the FlightCtrl made of it."""
    before = {slot: ParameterSet.from_payload(raw) for slot, raw in done.before.items()}
    planned = {slot: spell_changes(before[slot], source.parameters) for slot, source in sets.items()}
    if dry_run:
        _print_changes(connection, planned, "would change {name} from {before} to {after}")
        return
    stored = {slot: ParameterSet.from_payload(raw) for slot, raw in done.stored.items()}
    own_will = {slot: spell_changes(source.parameters, stored[slot]) for slot, source in sets.items()}
    if connection.json:
        print(json.dumps({"written": done.written, "active": done.active, "changed_by_fc": _plain(own_will)}))
        return
    _print_changes(connection, planned, "{name}: {before} -> {after}")
    _print_changes(connection, own_will, "the FC changed {name} from {before} to {after}", silent=True)
    print(f"set {done.active} is active and live" if done.written else "nothing had to be written")


def _print_changes(
    connection: Connection, changes: dict[int, tuple[SpelledChange, ...]], form: str, *, silent: bool = False
) -> None:
    if connection.json:
        print(json.dumps(_plain(changes)))
        return
    for slot, found in changes.items():
        for change in found:
            before, after = (_spell(value) for value in change[1:])
            print(f"set {slot}: " + form.format(name=change.name, before=before, after=after))
    if not any(changes.values()) and not silent:
        print("no difference")


def _plain(changes: dict[int, tuple[SpelledChange, ...]]) -> dict[int, list[dict[str, Spelled | None]]]:
    return {slot: [change._asdict() for change in found] for slot, found in changes.items()}


def _sets(found: Backup) -> dict[int, ParameterSet]:
    return {slot: ParameterSet.from_payload(raw) for slot, raw in found.sets.items()}


def _split(change: str) -> tuple[str, str]:
    name, equals, value = change.partition("=")
    if not equals or not name:
        msg = f"{change!r} is no change; write NAME=VALUE, for example gyro_p=85"
        raise ConfigError(msg)
    return name.strip().replace("-", "_"), value.strip()


def _change(current: ParameterSet, wanted: dict[str, str]) -> ParameterSet:
    layout = current.layout
    if layout is None:
        raise ConfigError(f"{current.reason}; nothing can be changed by name")
    values: dict[str, Value] = {}
    try:
        for name, text in wanted.items():
            is_list = layout.place(name).parameter.bits or "," in text
            spelled: object = [word for word in text.split(",") if word] if is_list and not text.isdecimal() else text
            if isinstance(spelled, list) and all(word.isdecimal() for word in spelled) and spelled:
                spelled = [int(word) for word in spelled]
            value = values[name] = parse_value(layout, name, spelled)
            parameter = layout.place(name).parameter
            if isinstance(value, int) and value != current[name] and not is_useful(parameter, value):
                msg = f"{name} takes 0..{parameter.high}, not {value}: {parameter.meaning}"
                raise ConfigError(msg)
        return current.replaced(values)
    except ProtocolError as error:
        raise ConfigError(f"{error}; `mkctl settings show` lists names and values") from error


def _spell(value: object) -> str:
    if value is None:
        return "absent"
    return ",".join(str(part) for part in value) or "none" if isinstance(value, list) else str(value)

"""`mkctl board mixer`: how throttle and sticks drive each motor."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import App, Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.errors import ConfigError
from mkdaemon.files import refuse_existing, save
from mkdaemon.foreignfiles import LONGEST_SETTINGS, parse_toml, read_text
from mkdaemon.protocol.messages import WriteMixer

app = App(name="mixer", help="Mixer of the FlightCtrl: 16 rows of throttle, pitch, roll, yaw; 64 is 100 %.")

COLUMNS: Final = ("throttle", "pitch", "roll", "yaw")
ROWS: Final = 16


@app.command
async def read(
    file: Annotated[Path | None, Parameter(help="Save as TOML; by default print the table.")] = None,
    /,
    *,
    force: Annotated[bool, Parameter(help="Overwrite an existing file.")] = False,
    connection: Connection = HERE,
) -> None:
    """Show or save the mixer.

    Example: mkctl board mixer read quadro.toml

    Raises:
        ConfigError: the file is there already.
        MkError: the FlightCtrl did not answer, or the file cannot be written.
    """
    if file is not None:
        refuse_existing(file, overwrite=force)
    async with connection.open() as uav:
        mixer = await uav.mixer.read()
    if file is not None:
        save(file, to_toml(mixer.name, mixer.motors), overwrite=force)
        print(f"saved {file}")
    else:
        connection.show({"name": mixer.name, "motors": _rows(mixer.motors)}, to_toml(mixer.name, mixer.motors).rstrip())


@app.command
async def write(
    file: Annotated[Path, Parameter(help="TOML as `mixer read` writes it.")],
    /,
    *,
    confirm: Annotated[bool, Parameter(help="I know that a wrong mixer flips the aircraft.")] = False,
    connection: Connection = HERE,
) -> None:
    """Store a mixer, read it back and compare. The FlightCtrl uses it at once, in flight too.

    Example: mkctl board mixer write quadro.toml --confirm

    Raises:
        ConfigError: the file is no mixer, or it was not confirmed.
        MkError: motors run, or the FlightCtrl refused it or holds another one afterwards.
    """
    wanted = from_toml(file)
    if not confirm:
        raise ConfigError(f"{file}: a wrong mixer flips the aircraft; check the rows and repeat with --confirm")
    async with connection.open() as uav:
        stored = await uav.mixer.write(wanted.name, wanted.motors, confirm=confirm)
    print(f"stored and read back: {stored.name}")


def to_toml(name: str, motors: tuple[int, ...]) -> str:
    """Return a mixer as TOML, rows without a motor left out at the end."""
    lines = [f"name = {json.dumps(name)}", "# motor = [throttle, pitch, roll, yaw], 64 is 100 %", "[motors]"]
    rows = _rows(motors)
    used = max((n for n, row in enumerate(rows, 1) if any(row)), default=0)
    return "\n".join([*lines, *(f"{n} = {row}" for n, row in enumerate(rows[:used], 1))]) + "\n"


def from_toml(file: Path) -> WriteMixer:
    """Read a mixer; rows that are absent are zero.

    Raises:
        ConfigError: the file cannot be used; names it and the fix.
    """
    try:
        content: dict[str, Any] = parse_toml(read_text(file, limit=LONGEST_SETTINGS))
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read ({error.strerror}); check the name") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{file}: no TOML: {error}; `mkctl board mixer read FILE` writes one") from error
    motors = [0] * (4 * ROWS)
    rows = content.get("motors")
    if not isinstance(rows, dict) or not rows:
        raise ConfigError(f"{file}: no table [motors]; `mkctl board mixer read FILE` writes one")
    for number, row in rows.items():
        if not number.isdecimal() or not 1 <= int(number) <= ROWS:
            raise ConfigError(f"{file}: motor {number!r}; motors are 1 to {ROWS}")
        if not _is_row(row):
            raise ConfigError(f"{file}: motor {number} is {row!r}; write [throttle, pitch, roll, yaw], each -128..127")
        motors[4 * int(number) - 4 : 4 * int(number)] = row
    name = str(content.get("name", ""))
    if len(name) > 12 or not name.isascii():
        raise ConfigError(f"{file}: the name {name!r} must be at most 12 ASCII characters")
    return WriteMixer(name=name, motors=tuple(motors))


def _is_row(row: object) -> bool:
    return (
        isinstance(row, list)
        and len(row) == len(COLUMNS)
        and all(isinstance(value, int) and not isinstance(value, bool) and -128 <= value <= 127 for value in row)
    )


def _rows(motors: tuple[int, ...]) -> list[list[int]]:
    return [list(motors[4 * n : 4 * n + 4]) for n in range(ROWS)]

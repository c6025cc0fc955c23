"""`mkctl board mixer`: how throttle and sticks drive each motor."""

from __future__ import annotations

import json
from itertools import chain
from pathlib import Path
from typing import Annotated, Final

from cyclopts import App, Parameter
from pydantic import Field

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.config.base import Section
from mkdaemon.config.reader import load_section
from mkdaemon.errors import ConfigError
from mkdaemon.files import refuse_existing, save
from mkdaemon.protocol.messages import WriteMixer

app = App(name="mixer", help="Mixer of the FlightCtrl: 16 rows of throttle, pitch, roll, yaw; 64 is 100 %.")

COLUMNS: Final = ("throttle", "pitch", "roll", "yaw")
ROWS: Final = 16
Share = Annotated[int, Field(ge=-128, le=127)]
Motor = Annotated[str, Field(pattern="^([1-9]|1[0-6])$")]
Row = tuple[Share, Share, Share, Share]


class MixerFile(Section):
    """A mixer as a file holds it."""

    name: Annotated[str, Field(max_length=12, pattern="^[ -~]*$")] = ""
    """At most twelve ASCII characters."""
    motors: dict[Annotated[str, Field(pattern=f"^({'|'.join(map(str, range(1, ROWS + 1)))})$")], Row] = Field(
        min_length=1
    )
    """The row of each motor, 1 to 16: throttle, pitch, roll, yaw; 64 is 100 %."""


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
    found = load_section(MixerFile, file)
    rows = (found.motors.get(str(number), (0,) * len(COLUMNS)) for number in range(1, ROWS + 1))
    return WriteMixer(name=found.name, motors=tuple(chain.from_iterable(rows)))


def _rows(motors: tuple[int, ...]) -> list[list[int]]:
    return [list(motors[4 * n : 4 * n + 4]) for n in range(ROWS)]

"""`mkctl status`: the aircraft, the link and the lease, on one screen."""

from __future__ import annotations

from typing import Final

from rich.table import Table
from rich.text import Text

from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE
from mkdaemon.reading import Picture
from mkdaemon.reading.facts import age_words
from mkdaemon.telemetry.tone import Tone

STYLES: Final = {Tone.NOTE: "", Tone.OK: "", Tone.WARN: "yellow", Tone.BAD: "bold red", Tone.UNKNOWN: "dim"}


async def status(*, connection: Connection = HERE) -> int:
    """Show the aircraft, the link and the lease; the first line is the worst of it.

    Exit code 0 while the vehicle is alive, 1 while it is not.

    Example: mkctl status --vehicle mk2
    """
    async with connection.open() as client:
        found = await client.status()
    if connection.json:
        print(json_line({suffix: sample.fields for suffix, sample in found.samples.items()}))
    else:
        Console().print(render(connection.vehicle, found.picture()))
    return 0 if found.is_alive else EXIT_FAILURE


def render(vehicle: str, picture: Picture) -> Table:
    """The screen.

    Args:
        vehicle: its name.
        picture: what is known of it.
    """
    table = Table(show_header=False, box=None, pad_edge=False, title=f"vehicle {vehicle}", title_justify="left")
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    table.add_column(style="dim", justify="right")
    first = STYLES[picture.tone] or "bold"
    table.add_row("now", Text(picture.headline, first))
    for alarm in picture.alarms[1:]:
        table.add_row("", Text(alarm.text, STYLES[alarm.tone]))
    for fact in picture.facts:
        age = "" if fact.age is None else age_words(fact.age)
        table.add_row(Text(fact.name), Text(fact.aged, STYLES[fact.tone]), age)
    return table

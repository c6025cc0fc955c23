"""`python -m lab record`: what recording costs, and what is left of it after every bad end.

`writing` times entries on their way into a file and back; `cost` flies a daemon with and without its black box, in
turns; `playing` records a flight, plays it, and records that again; `kills` ends daemons and recorders by `kill -9` at
random moments; `disks` fills and removes what they write to.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from lab.campaign import Row
from lab.record import cost, disks, kills, playing, writing
from lab.tables import show
from mkdaemon.cli.arguments import AsJson, Count, Length

SLOW_SECONDS: Final = 8.0
"""Of entries that come to the slow disk [s]."""
ENTRIES, TURNS = 60_000, 3
"""Of `writing`, and of `cost`."""
CASES: Final = ("writing", "cost", "playing", "kills", "disks")


def main(
    *,
    case: Annotated[
        Literal["writing", "cost", "playing", "kills", "disks"] | None, Parameter(help="One; all by default.")
    ] = None,
    runs: Annotated[Count, Parameter(help="Kills of the daemon, as many of the recorder, and of both.")] = 50,
    seconds: Annotated[Length, Parameter(help="Of each flight of `cost` and `playing`.")] = 20.0,
    as_json: AsJson = False,
) -> int:
    """Measure recording. All cases take about 15 minutes; `--case writing` half a minute.

    Exit code 0 only if nothing older than 1.1 s was lost, every file was readable and no flight was disturbed.
    """
    rows = [
        {"case": name, "what": ""} | row for name in ([case] if case else CASES) for row in _rows(name, runs, seconds)
    ]
    return show(rows, ("case", "what"), as_json=as_json)


def _rows(case: str, runs: int, seconds: float) -> Iterator[Row]:
    match case:
        case "writing":
            yield writing.measure(ENTRIES)
        case "cost":
            yield asyncio.run(cost.measure(seconds, TURNS))
        case "playing":
            found = asyncio.run(playing.measure(seconds))
            yield found | {"holds": is_the_same(found)}
        case "kills":
            for victim in kills.VICTIMS:
                found = asyncio.run(_repeat(victim, runs))
                yield {"what": victim} | found | {"holds": kills.is_kept(found)}
        case _:
            yield _of_disk("full", asyncio.run(disks.fill_disk(1)))
            yield _of_disk("removed", asyncio.run(disks.remove_folder(1)))
            yield _of_disk("slow", disks.slow_disk(SLOW_SECONDS))


def _of_disk(what: str, found: Row) -> Row:
    return {"what": what} | found | {"holds": found["readable"]}


async def _repeat(victim: str, runs: int) -> Row:
    found = []
    for seed in range(runs):
        found.append(await kills.kill(victim, seed))
        print(f"{victim} {seed + 1}/{runs}: {found[-1]}", file=sys.stderr)
    return {"kills": runs} | kills.sum_up(found)


def is_the_same(played: Row) -> bool:
    """Whether a flight that was played and recorded again is the one that was recorded."""
    is_changed = played["keys_that_differ"] or played["out_of_order"] or played["not_put"]
    return not is_changed and played["values"] == played["values_played"]

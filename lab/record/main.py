"""`python -m lab record`: what recording costs, and what is left after a kill and on a disk that fails."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from lab.campaign import Row
from lab.record import cost, disks, kills
from lab.tables import show
from mkdaemon.cli.arguments import AsJson, Count, Length

TURNS: Final = 3
"""Of each flight of `cost`."""
CASES: Final = ("cost", "kills", "disks")


def main(
    *,
    case: Annotated[Literal["cost", "kills", "disks"] | None, Parameter(help="One; all by default.")] = None,
    runs: Annotated[Count, Parameter(help="Kills of the daemon, as many of the recorder, and of both.")] = 50,
    seconds: Annotated[Length, Parameter(help="Of each flight of `cost`.")] = 20.0,
    as_json: AsJson = False,
) -> int:
    """Measure recording. All cases take about 15 minutes.

    Exit code 0 only if nothing older than 1.1 s was lost, every file was readable and no flight was disturbed.
    """
    rows = [
        {"case": name, "what": ""} | row for name in ([case] if case else CASES) for row in _rows(name, runs, seconds)
    ]
    return show(rows, ("case", "what"), as_json=as_json)


def _rows(case: str, runs: int, seconds: float) -> Iterator[Row]:
    match case:
        case "cost":
            yield asyncio.run(cost.measure(seconds, TURNS))
        case "kills":
            for victim in kills.VICTIMS:
                found = asyncio.run(_repeat(victim, runs))
                yield {"what": victim} | found | {"holds": kills.is_kept(found)}
        case _:
            for what, fail in (("full", disks.fill_disk), ("removed", disks.remove_folder)):
                found = asyncio.run(fail(1))
                yield {"what": what} | found | {"holds": found["readable"]}


async def _repeat(victim: str, runs: int) -> Row:
    found = []
    for seed in range(runs):
        found.append(await kills.kill(victim, seed))
        print(f"{victim} {seed + 1}/{runs}: {found[-1]}", file=sys.stderr)
    return {"kills": runs} | kills.sum_up(found)

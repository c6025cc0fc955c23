"""`python -m lab record`: what recording costs, and what is left of it after every bad end.

`writing` times entries on their way into a file and back; `cost` flies a daemon with and without its black box, in
turns, and times the event loop beside the recorder's thread; `playing` records a flight, plays it, and records that
again; `kills` ends daemons and recorders by `kill -9` at random
moments; `disks` fills and removes what they write to.
"""

from __future__ import annotations

import asyncio
import sys
from typing import Annotated, Any, Final, Literal

from cyclopts import Parameter

from lab.record import cost, disks, kills, looplag, playing, writing
from mkdaemon.cli.arguments import AsJson, Count, Length
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK

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
    figures: dict[str, Any] = {}
    for name in CASES if case is None else (case,):
        match name:
            case "writing":
                figures[name] = writing.measure(ENTRIES)
            case "cost":
                figures[name] = asyncio.run(cost.measure(seconds, TURNS))
                figures[name]["loop"] = looplag.measure(2 * TURNS)
            case "playing":
                figures[name] = asyncio.run(playing.measure(seconds))
            case "kills":
                figures[name] = {victim: asyncio.run(_repeat(victim, runs)) for victim in kills.VICTIMS}
            case _:
                figures[name] = {
                    "full": asyncio.run(disks.fill_disk(1)),
                    "removed": asyncio.run(disks.remove_folder(1)),
                    "slow": disks.slow_disk(SLOW_SECONDS),
                }
        if not as_json:
            print(f"{name}: {json_line(figures[name])}")
    if as_json:
        print(json_line(figures))
    return EXIT_OK if is_right(figures) else EXIT_FAILURE


async def _repeat(victim: str, runs: int) -> dict[str, Any]:
    found = []
    for seed in range(runs):
        found.append(await kills.kill(victim, seed))
        print(f"{victim} {seed + 1}/{runs}: {found[-1]}", file=sys.stderr)
    return kills.sum_up(found)


def is_right(figures: dict[str, Any]) -> bool:
    """Whether the figures keep what docs/lab/recording.md promises."""
    ends = figures.get("kills", {}).values()
    played = figures.get("playing")
    is_same = played is None or (
        not (played["keys_that_differ"] or played["out_of_order"] or played["not_put"])
        and played["values"] == played["values_played"]
    )
    is_kept = all(
        not (one["older_than_allowed"] or one["frames_missing"] or one["gaps"] or one["unreadable"]) for one in ends
    )
    return is_kept and is_same and all(one["readable"] for one in figures.get("disks", {}).values())

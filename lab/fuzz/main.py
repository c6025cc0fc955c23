"""`python -m lab fuzz`: nonsense for a running daemon, for its bus, and for the flight core alone."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.campaign import First, Jobs, Kept
from lab.cases import silence_log
from lab.fuzz.bus import fuzz_bus
from lab.fuzz.core import run_sequences, shortened
from lab.fuzz.requests import fuzz
from lab.tables import show
from mkdaemon.cli.arguments import AsJson

MOST_SHOWN: Final = 20
"""Sequences whose first breach is told."""


def main(
    *,
    seconds: Annotated[float, Parameter(help="Duration [s].")] = 600.0,
    first: First = 1,
    bus: Annotated[bool, Parameter(help="Key expressions of every kind in place of requests, with readers.")] = False,
    count: Annotated[int, Parameter(help="With --bus: puts, deletions, queries and tokens.")] = 100_000,
    core: Annotated[
        bool, Parameter(help="The flight core alone, in virtual time: sequences of random events.")
    ] = False,
    seeds: Annotated[int, Parameter(help="How many sequences, with --core.")] = 20_000,
    jobs: Jobs = 1,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Ask, tell and configure a running daemon nonsense for ten minutes; exit code 1 if it minds.

    It must live and not grow, answer every query, name every refusal by a token that docs/keys.md lists, count every
    setpoint that it refuses, and say of every damaged configuration file what is wrong with it, or take it up.

    With `--bus` the daemon and the programs that read from it must live and write no traceback (a few minutes).

    With `--core` a toy aircraft, a client, a pilot, boards and cameras do 300 random things a sequence to the flight
    core; `lab.fuzz.corejudge` lists what must never be, and `lab.fuzz.core` what has to be reached. `--jobs` and
    `--results` are for it alone.
    """
    silence_log()
    if core:
        return _fuzz_core(first, seeds, jobs, results, as_json=as_json)
    found: Any = asyncio.run(fuzz_bus(count, first) if bus else fuzz(seconds, first, shows=True))
    row = {"what": "bus" if bus else "requests"} | vars(found) | {"holds": found.holds}
    return show([row], ("what",), as_json=as_json)


def _fuzz_core(first: int, count: int, jobs: int, results: Path | None, *, as_json: bool) -> int:
    """Run sequences of events for the flight core; exit code 1 for a broken promise, or what was not reached."""
    found = run_sequences(first, count, jobs, results)
    row = {
        "what": "core",
        "sequences": found.sequences,
        "breaches": len(found.breaches),
        "virtual_s": round(found.seconds),
        "cpu_s_each": round(found.cpu / found.sequences, 3),
        "ticks": found.reached["tick"],
        "in_flight_percent": round(100.0 * found.share_in_flight, 1),
        "unreached": found.unreached,
        "holds": not found.breaches and not found.unreached,
    }
    for seed in sorted(found.breaches)[:MOST_SHOWN]:
        print(f"seed {seed}: {found.breaches[seed][0]}", file=sys.stderr)
    for happening in shortened(min(found.breaches)) if found.breaches else ():
        print(f"shortest of seed {min(found.breaches)}: {happening}", file=sys.stderr)
    told = {"in_flight": found.ticks, "reached": found.reached, "wrong": found.breaches}
    return show([row], ("what",), as_json=as_json, **told)

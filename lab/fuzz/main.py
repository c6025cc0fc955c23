"""`python -m lab fuzz`: nonsense for a running daemon, for its bus, and for the flight core alone."""

from __future__ import annotations

import asyncio
import sys
from typing import Annotated, Final

from cyclopts import Parameter

from lab.campaign import First, Jobs, Kept
from lab.cases import silence_log
from lab.fuzz.bus import fuzz_bus
from lab.fuzz.core import run_sequences, shortened
from lab.fuzz.requests import fuzz
from lab.tables import show
from mkdaemon.cli.arguments import AsJson

MOST_SHOWN: Final = 20
"""Sequences whose first breach is named."""


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
    if not core:
        found = asyncio.run(fuzz_bus(count, first) if bus else fuzz(seconds, first))
        return show([{"what": "bus" if bus else "requests"} | found], ("what",), as_json=as_json)
    found = run_sequences(first, seeds, jobs, results)
    breaches, reached = found["breaches"], found["reached"]
    for seed in sorted(breaches)[:MOST_SHOWN]:
        print(f"seed {seed}: {breaches[seed][0]}", file=sys.stderr)
    for happening in shortened(min(breaches)) if breaches else ():
        print(f"shortest of seed {min(breaches)}: {happening}", file=sys.stderr)
    row = {"what": "core", "sequences": found["sequences"], "breaches": len(breaches), "ticks": reached["tick"]}
    row |= {"in_flight_percent": round(100.0 * reached["in flight"] / reached["tick"], 1)}
    row |= {"unreached": found["unreached"], "holds": not breaches and not found["unreached"]}
    return show([row], ("what",), as_json=as_json, reached=reached, wrong=breaches)

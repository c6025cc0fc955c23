"""`python -m lab teleop`: hands lost in flight, in virtual time, and a stick's way to the line, in real time."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Annotated, Final, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from lab.rigs.cockpit import Boards
from lab.stories.deaths import NEUTRAL_TIME, RELEASE_TIME
from lab.stories.losses import silence_log
from lab.stories.page import Row
from lab.teleop.losses import HandsLost, Way, lose_hands
from mkdaemon.cli.arguments import AsJson

GENERATIONS: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"))
"""One FlightCtrl of each dead-man generation."""
SESSION: Final = 10
"""Losses between two discoveries of the boards."""
MOVES: Final = 1000

Case = Literal["unplug", "freeze", "kill", "ssh", "two_pads", "stuck", "latency"]


def run_losses(way: Way, runs: int) -> Iterator[Row]:
    """Lose hands in one way, on every generation."""
    for boards in GENERATIONS:
        sessions = range(1, math.ceil(runs / SESSION) + 1)
        found = [loss for seed in sessions for loss in lose_hands(boards, seed, way, SESSION)][:runs]
        yield loss_row(boards.name, way, found)


def loss_row(boards: str, way: Way, found: Sequence[HandsLost]) -> Row:
    """One line of losses of the same way on the same boards."""
    wire = [math.inf if loss.wire is None else loss.wire for loss in found]
    released = [math.inf if loss.released is None else loss.released for loss in found]
    after = sum(loss.relapses for loss in found)
    foreign = sum(loss.foreign for loss in found)
    second = f"; {foreign} of the second pad" if way is Way.TWO_PADS else ""
    figure = (
        f"neutral on the wire longest {1000 * max(wire):.0f} ms; released in the FC longest "
        f"{1000 * max(released):.0f} ms; {after} stick frames after{second}"
    )
    limit = f"{1000 * NEUTRAL_TIME:g} ms; {1000 * RELEASE_TIME:g} ms; 0"
    holds = max(wire) <= NEUTRAL_TIME and max(released) <= RELEASE_TIME and not after and not foreign
    detail = {"losses": [asdict(loss) for loss in found]}
    return Row("teleop", f"hands lost: {way.value.replace('_', ' ')}", boards, len(found), figure, limit, holds, detail)


def run_latency(moves: int) -> Iterator[Row]:
    """Measure the way from a stick to the line."""
    from lab.teleop.latency import LIMIT, measure_latency  # wants evdev, which not every machine has

    found = asyncio.run(measure_latency(moves))
    figure = (
        f"event to `b` frame median {found.p50_ms:g} ms, p99 {found.p99_ms:g} ms, longest {found.max_ms:g} ms; "
        f"{found.unseen} unseen; {found.rate:g} frames a second; load {found.load[0]:g} to {found.load[1]:g}"
    )
    yield Row("teleop", "a stick moves", "FC 2.12a", found.moves, figure, f"p99 {1000 * LIMIT:g} ms", found.holds,
              asdict(found))  # fmt: skip


def main(
    *,
    case: Annotated[Case | None, Parameter(help="One case; all by default.")] = None,
    runs: Annotated[int | None, Parameter(help="Losses of every row (50), or moves of the stick (1000).")] = None,
    as_json: AsJson = False,
) -> int:
    """Lose pads, terminals and programs in flight, and time a stick; exit code 1 if a limit is broken.

    The losses run in virtual time and are the same on every machine, some five minutes of processor time. `latency`
    runs processes in real time for two minutes: leave the machine alone.
    """
    silence_log()
    rows: list[Row] = []
    for way in Way:
        if case in {None, way.value}:
            rows.extend(run_losses(way, runs or 50))
    if case in {None, "latency"}:
        rows.extend(run_latency(runs or MOVES))
    holds = all(row.holds for row in rows)
    if as_json:
        print(json.dumps({"rows": [asdict(row) for row in rows], "holds": holds}))
    else:
        table = Table("what", "boards", "runs", "figure", "limit", "holds")
        for row in rows:
            table.add_row(row.story, row.boards, str(row.runs), row.figure, row.limit, "yes" if row.holds else "NO")
        Console().print(table)
    return 0 if holds else 1

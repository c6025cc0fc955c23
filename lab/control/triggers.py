"""Every trigger of the safety table, on every generation of boards: `python -m lab control --case triggers`.

The whole daemon but Zenoh flies simulated boards in virtual time (`lab.rigs.cockpit`). What is measured is what leaves
on the wire and what the FlightCtrl holds, from the event on. Source of the times: docs/safety.md.
"""

from __future__ import annotations

import asyncio
import random
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

from lab.campaign import Campaign, Ending, Row, summed_up
from lab.control.triggerrig import CLIENT, Client, Scene
from lab.control.triggerstories import DEAD_MAN, TRIGGERS
from lab.rigs.boardport import TICK_TIME
from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.virtualguard import VirtualGuard
from lab.rigs.waiting import in_virtual_time, running

SHARE: Final = 0.2
"""A trigger fires at its time, give or take this share."""
BY_NAME: Final = {trigger.name: trigger for trigger in TRIGGERS}
ELSEWHERE: Final = {
    "the aircraft does not follow its sticks": "lab.hil.triggers",
    "a landing waits": "lab.fuzz.core",
    "a take-off does not reach its height": "lab.fuzz.core",
    "a gamepad is lost": "lab.stories.hands",
}
"""Rows of that table whose times another campaign measures, and its module."""


def fire(name: str, boards: Boards, seed: int, tick: float = TICK_TIME) -> Row:
    """Let one trigger fire once; bytes are carried every `tick` [s].

    Returns:
        Its `ending`, and `at`, when it fired after the event [s]; infinite for never.
    """
    trigger, at = BY_NAME[name], _fire(name, boards, seed, tick)
    wanted = trigger.time(boards)
    is_right = abs(at - wanted) <= SHARE * wanted + trigger.slack
    why = "" if is_right else f"{boards.name} fired at {at:.2f} s"
    return {"ending": Ending.FINISHED if is_right else Ending.WRONG, "why": why, "at": at}


@in_virtual_time
async def _fire(name: str, boards: Boards, seed: int, tick: float) -> float:
    guard = VirtualGuard()
    rates: dict[str, Any] = {"rates": {"osd": 200}} if boards.nc else {}
    async with (
        cockpit(boards, seed, tick=tick, guard=guard, **rates) as flown,
        AsyncExitStack() as on,
    ):
        on.callback(guard.stop)
        client = Client(flown)
        await asyncio.sleep(random.Random(f"{seed} {name}").uniform(0.0, 0.5))
        await flown.take(CLIENT)
        for work in (client.stream(), client.see()):
            await on.enter_async_context(running(work))
        return await BY_NAME[name].fire(Scene(flown, client, guard))


Work = tuple[str, Boards, int]
"""Name of a trigger, the boards, the seed."""


def _row(work: Work) -> Row:
    return fire(*work)


FIRINGS: Final = Campaign(
    "control triggers", _row, lambda work: {"trigger": work[0], "boards": work[1].name, "seed": work[2]}
)


def run_triggers(runs: int | None, first_seed: int, jobs: int, results: Path | None = None) -> dict[str, Row]:
    """Let every trigger fire on every generation; figures by key."""
    seeds = range(first_seed, first_seed + (runs or 3))
    work = [(trigger.name, boards, seed) for trigger in TRIGGERS for boards in trigger.boards for seed in seeds]
    rows = FIRINGS.rows(work, jobs, results)
    return {
        f"trigger_{trigger.name}_s": summed_up([row for row in rows if row["trigger"] == trigger.name], "at")
        | {"goal": DEAD_MAN if trigger.at is None else trigger.at}
        for trigger in TRIGGERS
    }

"""Every trigger of the safety table, on every generation of boards: `python -m lab control --case triggers`.

The whole daemon but Zenoh flies simulated boards in virtual time (`lab.rigs.cockpit`). What is measured is what leaves
on the wire and what the FlightCtrl holds, from the event on. Source of the times: docs/safety.md.
"""

from __future__ import annotations

import asyncio
import math
import random
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final

from lab.campaign import Campaign, Ending, Row
from lab.control import linestories, triggerstories
from lab.control.triggerrig import CLIENT, Client, Scene
from lab.control.triggerstories import Story
from lab.rigs.boardport import TICK_TIME
from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.cockpitclient import PublishedValues
from lab.rigs.virtualguard import VirtualGuard
from mkdaemon.control.flightwatch import LASTING
from mkdaemon.virtualtime import run_virtually

GENERATIONS: Final = (
    Boards("early"),
    Boards("2.08"),
    Boards("2.12a"),
    Boards("2.14"),
    Boards("2.12a", "0.24"),
    Boards("2.12a", "2.14"),
)
"""The boards that fly."""
DEAD_MAN: Final = {"early": 0.5, "2.08": 5.25, "2.12a": 2.05, "2.14": 2.05}
"""After the last stick frame the FlightCtrl holds the sticks for so long [s]; docs/safety.md."""
SHARE: Final = 0.2
"""A trigger fires at its time, give or take this share."""
PROMPT: Final = 0.05
"""And give or take this [s]: two control periods, and a frame on the wire."""
TELEMETRY: Final = 0.25
"""What only telemetry shows is known with its next message: 5 Hz, and the time on the wire [s]."""


class Shown(Enum):
    """Which boards show an event to the daemon, or to this rig."""

    EVERYWHERE = "everywhere"
    ON_A_CABLE = "on a cable to the FlightCtrl"
    BY_A_NAVICTRL = "by a NaviCtrl"

    def is_shown(self, boards: Boards) -> bool:
        """Whether these boards show it."""
        match self:
            case Shown.ON_A_CABLE:
                return boards.nc is None
            case Shown.BY_A_NAVICTRL:
                return boards.nc is not None
            case _:
                return True


@dataclass(frozen=True, slots=True)
class Trigger:
    """One time of a row of the safety table.

    Attributes:
        event: the row, as docs/safety.md names it.
        story: what happens; the time that it took [s].
        at: when it has to fire [s]; None for the dead-man of the boards that fly.
        shown: where it can happen, or be seen.
        slack: beside the share of the time [s].
    """

    event: str
    story: Story
    at: float | None
    shown: Shown = Shown.EVERYWHERE
    slack: float = PROMPT

    @property
    def name(self) -> str:
        """In words."""
        return self.story.__name__

    @property
    def boards(self) -> tuple[Boards, ...]:
        """The boards it is seen on."""
        return tuple(boards for boards in GENERATIONS if self.shown.is_shown(boards))

    def time(self, boards: Boards) -> float:
        """When it has to fire with these boards [s]."""
        return DEAD_MAN[boards.fc] if self.at is None else self.at


BLIND: Final = "the target is out of sight"
BATTERY: Final = "the battery is low"
NO_DATA: Final = "no data from the boards, or no answers"
NO_LINK: Final = "the link is down or absent"
SWITCHES: Final = "height control on, or GPS switch not at free, in flight by position"
PILOT: Final = "the pilot closes the gate or moves a stick"
GUARD: Final = "the daemon hangs or dies"
ENDED: Final = "`mkctl release`, or another client takes the lease with `--force`"
TRIGGERS: Final = (
    Trigger("the newest setpoint is too old", triggerstories.stale, 0.3),
    Trigger("still no setpoint", triggerstories.silent, 1.0),
    Trigger("the client's session ends", triggerstories.client_gone, 0.0),
    Trigger(BLIND, triggerstories.blind_frozen, 0.2),
    Trigger(BLIND, triggerstories.blind_searches, 1.0),
    Trigger(BLIND, triggerstories.blind_release, 3.0),
    Trigger(BLIND, triggerstories.eyes_stalled, 1.0),
    Trigger("no image confirms a take-off", triggerstories.blind_takeoff, 1.2),
    Trigger(BATTERY, linestories.battery_lands, LASTING),
    Trigger(BATTERY, linestories.battery_released, LASTING),
    Trigger("`mkctl abort`", triggerstories.aborted, 0.0),
    Trigger(ENDED, triggerstories.release_asked, 0.0),
    Trigger(ENDED, triggerstories.taken_over, 0.0),
    Trigger(NO_DATA, linestories.line_silent, 1.0),
    Trigger(NO_DATA, linestories.line_garbage, 1.0),
    Trigger(NO_DATA, linestories.one_way, 1.5),
    Trigger(NO_LINK, linestories.unplugged, 0.0),
    Trigger(NO_LINK, linestories.replugged, 0.03),
    Trigger("nothing reaches the FlightCtrl", linestories.dead_man, None, Shown.ON_A_CABLE),
    Trigger(SWITCHES, triggerstories.height_control, 0.0, Shown.BY_A_NAVICTRL, TELEMETRY + PROMPT),
    Trigger(SWITCHES, triggerstories.gps_switch, 0.0, Shown.BY_A_NAVICTRL, TELEMETRY + PROMPT),
    Trigger("the pilot's throttle is lower than ours", triggerstories.throttle_capped, 0.4, slack=2 * TELEMETRY),
    Trigger("the receiver is lost", triggerstories.receiver_lost, 0.0, slack=TELEMETRY),
    Trigger("the daemon did not run for 0.3 s", triggerstories.daemon_stalled, 0.0),
    Trigger(GUARD, triggerstories.guard_neutral, 0.25),
    Trigger(GUARD, triggerstories.guard_release, 0.8),
    Trigger(PILOT, triggerstories.gate_shut, 0.0),
    Trigger(PILOT, triggerstories.pilots_stick, 0.0),
    Trigger("no client holds the lease", triggerstories.no_lease, 0.0),
)
"""Every trigger of docs/safety.md, "What ends a flight"."""
ELSEWHERE: Final = {
    "the aircraft does not follow its sticks": "lab.hil.triggers",
    "a landing waits": "lab.fuzz.core",
    "a take-off does not reach its height": "lab.fuzz.core",
    "a gamepad is lost": "lab.teleop.losses",
}
"""Rows of that table whose times another campaign measures, and its module."""


@dataclass(frozen=True, slots=True)
class Fired:
    """One trigger, seen once.

    Attributes:
        trigger: name.
        boards: that flew.
        at: when it fired after the event [s]; infinite for never.
        wanted: when it had to [s].
        slack: beside the share of that [s].
    """

    trigger: str
    boards: str
    at: float
    wanted: float
    slack: float

    @property
    def is_right(self) -> bool:
        """Whether it fired at its time."""
        return abs(self.at - self.wanted) <= SHARE * self.wanted + self.slack


def fire(trigger: Trigger, boards: Boards, seed: int, tick: float = TICK_TIME) -> Fired:
    """Let one trigger fire once; bytes are carried every `tick` [s]."""
    took = run_virtually(_fire(trigger, boards, seed, tick))
    return Fired(trigger.name, boards.name, took, trigger.time(boards), trigger.slack)


async def _fire(trigger: Trigger, boards: Boards, seed: int, tick: float) -> float:
    guard, published = VirtualGuard(), PublishedValues()
    rates: dict[str, Any] = {"rates": {"osd": 200}} if boards.nc else {}
    async with cockpit(boards, seed, tick=tick, guard=guard, outlet=published, **rates) as flown:
        client = Client(flown)
        await asyncio.sleep(random.Random(f"{seed} {trigger.name}").uniform(0.0, 0.5))
        await flown.take(CLIENT)
        tasks = [asyncio.create_task(work, name="client") for work in (client.stream(), client.see())]
        try:
            return await trigger.story(Scene(flown, client, guard, published))
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            guard.stop()


Work = tuple[Trigger, Boards, int]
"""A trigger, the boards, the seed."""


def _row(work: Work) -> Row:
    fired = fire(*work)
    return {
        "ending": Ending.FINISHED if fired.is_right else Ending.WRONG,
        "why": "" if fired.is_right else f"fired at {fired.at:.2f} s",
        "at": fired.at,
    }


FIRINGS: Final = Campaign(
    "control triggers", _row, lambda work: {"trigger": work[0].name, "boards": work[1].name, "seed": work[2]}
)


def run_triggers(
    runs: int | None, first_seed: int, jobs: int, results: Path | None = None
) -> dict[str, dict[str, Any]]:
    """Let every trigger fire on every generation; figures by key.

    Args:
        runs: times each; three if None.
        first_seed: seeds count up from here.
        jobs: processes.
        results: file in which what fired is kept.
    """
    seeds = range(first_seed, first_seed + (runs or 3))
    work = [(trigger, boards, seed) for trigger in TRIGGERS for boards in trigger.boards for seed in seeds]
    rows = FIRINGS.rows(work, jobs, results)
    figures = {}
    for trigger in TRIGGERS:
        seen = [row for row in rows if row["trigger"] == trigger.name]
        wrong = sorted({row["boards"] for row in seen if row["ending"] != Ending.FINISHED})
        times = [math.inf if row.get("at") is None else row["at"] for row in seen]
        figures[f"trigger_{trigger.name}_s"] = {
            "earliest": round(min(times), 3),
            "latest": round(max(times), 3),
            "goal": trigger.at if trigger.at is not None else str(DEAD_MAN),
            "count": len(seen),
            "wrong": wrong,
            "holds": not wrong,
        }
    return figures

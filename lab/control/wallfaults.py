"""What happens to the whole daemon in earnest, over a target, judged by the bytes on the wire and by what it says.

`python -m lab control --case wallfaults`. Processes as in `lab.fly`; times by docs/safety.md. In every
story no gap between stick frames is longer than the guard lets it become, until the aircraft is released.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import os
import signal
import sys
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from lab.campaign import Row
from lab.rigs.overtarget import Hover, Setting, favour, hovering
from lab.rigs.processes import MKCTL, PROGRAM, Program
from lab.rigs.troubled import DETECTOR, DISK, TROUBLE, Trouble
from lab.rigs.waiting import wait_until
from lab.rigs.wiretap import Sticks

SETTLING: Final = 3.0
"""It flies for so long before anything happens [s]."""
SHARE: Final = 1.2
"""A trigger fires at its time, at most so much later."""
SLACK: Final = 0.1
"""And this [s]: two processes stand between what happens and the wire."""
LEVEL: Final = 0.2
"""Sticks that stay level for so long are no chance [s]."""
AFTERWARDS: Final = 1.5
"""And is watched for so long when it is over [s]."""
WAIT: Final = 12.0
"""Longest wait for the end of a story [s]."""
SILENCE: Final = 0.35
"""Longest time between two stick frames of a flight [s]: the guard acts after 0.25, and a radio's worth of noise."""
HOLD: Final = 180.0
"""The operator would fly so long [s]."""
ENDED: Final = ("releasing", "free")
"""Phases after a flight."""
BUSY: Final = 10.0
"""Other programs are busy for so long [s]."""


async def operator_killed(hover: Hover, operator: Program) -> float:
    """The operator's program gets SIGKILL: released at once."""
    operator.send_signal(signal.SIGKILL)
    return await _released_after(hover)


async def operator_frozen(hover: Hover, operator: Program) -> float:
    """The operator's program stands still: level after 0.3 s, released after 1 s."""
    operator.send_signal(signal.SIGSTOP)
    return await _released_after(hover)


async def second_client(hover: Hover, operator: Program) -> float:
    """A second operator is refused, then takes the lease by force: the first one's flight ends with a release."""
    place = (*MKCTL, "hold", "--seconds", "5", "--vehicle", "mk1", "--connect", hover.endpoint)
    refused = await Program.start(*place, is_read=False)
    favour(refused.pid)
    if await refused.wait() == 0 or not hover.seen.is_flying:
        return math.nan
    at = time.monotonic()
    forced = await Program.start(*place, "--force", is_read=False)
    favour(forced.pid)
    await wait_until(lambda: not hover.seen.is_flying, WAIT)
    await forced.end()
    return at


async def camera_dead(hover: Hover, operator: Program) -> float:
    """The camera delivers nothing more: level after 1.5 s, released after 3 s."""
    fields: dict[str, Any] = {"action": "start", "name": "camera_off", "duration": None, "values": {}}
    (await hover.client.command("sim", "fault", fields)).require()
    await _released_after(hover)
    return hover.seen.captures[-1]


async def detector_stalled(hover: Hover, operator: Program) -> float:
    """The thread of the eyes stands still for 2 s: level after 1.5 s, then the flight goes on."""
    at = hover.seen.captures[-1]
    hover.daemon.send_signal(TROUBLE)
    await asyncio.sleep(DETECTOR + 1.0)
    return at


async def interpreter_stalled(hover: Hover, operator: Program) -> float:
    """A C call keeps the interpreter for 2 s, so nothing of the daemon runs: its guard levels and releases."""
    hover.daemon.send_signal(TROUBLE)
    return await _released_after(hover)


async def disk_stuck(hover: Hover, operator: Program) -> float:
    """A write of the recorder does not come back for 6 s: the flight goes on."""
    at = time.monotonic()
    hover.daemon.send_signal(TROUBLE)
    await asyncio.sleep(DISK + 0.5)
    return at


async def cores_busy(hover: Hover, operator: Program) -> float:
    """As many busy programs of ordinary priority as there are cores: the flight goes on, or ends as the table says."""
    at = time.monotonic()
    busy = [await Program.start("-c", "while True: pass") for _ in range(os.cpu_count() or 1)]
    await asyncio.sleep(BUSY)
    for one in busy:
        await one.end(signal.SIGKILL)
    return at


async def _released_after(hover: Hover) -> float:
    at = time.monotonic()
    # Level on its way to the release, a flight is `stale`: who acts then would end it in another way.
    await wait_until(lambda: hover.seen.phases[-1].startswith(ENDED), WAIT)
    return at


@dataclass(frozen=True, slots=True)
class Told:
    """One story, told.

    Attributes:
        hover: who flew; what the tap heard is complete.
        at: when it happened [s; monotonic].
        ended: what came later does not count [s; monotonic].
    """

    hover: Hover
    at: float
    ended: float

    @property
    def sticks(self) -> list[Sticks]:
        """Everything on the wire that steers."""
        assert self.hover.tap is not None
        return [stick for stick in self.hover.tap.sticks() if stick[0] < self.ended]

    def released(self) -> float:
        """From the event to the first frame of a release [s]; infinite for none."""
        return min((at for at, stick in self.sticks if at > self.at and not stick.config), default=math.inf) - self.at

    def level(self) -> float:
        """From the event to the first stick frame after which none tilts for `LEVEL`, or until the release [s]."""
        until, since = self.at + self.released(), math.inf
        for at, stick in self.sticks:
            if self.at < at < until and stick.config:
                since = min(since, at) if not (stick.pitch or stick.roll or stick.yaw) else math.inf
                if at - since >= LEVEL:
                    break
        return min(since, until) - self.at

    def gap(self) -> float:
        """Longest time between two stick frames, from the flight's first to its first release [s]."""
        until, since = self.at + self.released(), self.at - SETTLING
        times = [at for at, stick in self.sticks if since < at < until and stick.config]
        return max((after - before for before, after in itertools.pairwise(times)), default=0.0)


@dataclass(frozen=True, slots=True)
class Story:
    """Something that happens.

    Attributes:
        act: makes it happen; when it happened [s; monotonic].
        level: the sticks are level so long after it [s]; None where they need not be.
        release: the aircraft is released so long after it [s]; infinite where the flight goes on.
        words: what the daemon says of it then.
        trouble: of the daemon's own threads, where that is the story.
        may_end: the flight may end all the same, if the daemon says why.
    """

    act: Callable[[Hover, Program], Awaitable[float]]
    level: float | None = None
    release: float = math.inf
    words: str = ""
    trouble: Trouble | None = None
    may_end: bool = False

    def broken(self, told: Told) -> list[str]:
        """What does not hold of it."""
        seen, released = told.hover.seen, told.released()
        is_kept = released == math.inf or (self.may_end and bool(seen.failsafes))
        rules = {
            "level in time": self.level is None or told.level() <= SHARE * self.level + SLACK,
            "released in time": is_kept if self.release == math.inf else released <= SHARE * self.release + SLACK,
            "said": any(self.words in said for said in (*seen.phases, *seen.failsafes, *seen.eyes)),
            "no silence": told.gap() <= SILENCE,
        }
        return [rule for rule, holds in rules.items() if not holds]


STORIES: Final = {
    "operator_killed": Story(operator_killed, 0.3, 0.3, "is gone"),
    "operator_frozen": Story(operator_frozen, 0.3, 1.0, "no setpoint from"),
    "second_client": Story(second_client, None, 10.0, "took the lease"),
    "camera_dead": Story(camera_dead, 1.5, 3.0, "no image of"),
    "detector_stalled": Story(detector_stalled, 1.5, words="stalled", trouble=Trouble.DETECTOR),
    "interpreter_stalled": Story(interpreter_stalled, 0.25, 0.8, "guard release", Trouble.INTERPRETER),
    "disk_stuck": Story(disk_stuck, trouble=Trouble.DISK),
    "cores_busy": Story(cores_busy, may_end=True),
}
"""By name."""


def run_wallfaults(runs: int | None, first_seed: int, jobs: int) -> dict[str, Row]:
    """Tell every story; figures by key."""
    found: dict[str, Row] = {}
    for name, story in STORIES.items():
        told = [asyncio.run(tell(story, first_seed + k)) for k in range(runs or 1)]
        figures = found[f"wallfault_{name}"] = sum_up(story, told)
        print(f"{name}: {figures}", file=sys.stderr, flush=True)
    return found


async def tell(story: Story, seed: int) -> Told:
    """Let one story happen once."""
    program = PROGRAM if story.trouble is None else ("-m", "lab.rigs.troubled", story.trouble.value)
    setting = Setting(fps=30.0, seed=seed, latency_ms=30.0, jitter_ms=0.0, program=program, is_tapped=True)
    async with hovering(setting) as hover:
        operator = await hover.hold(HOLD)
        try:
            await asyncio.sleep(SETTLING)
            at = await story.act(hover, operator)
            await asyncio.sleep(AFTERWARDS)
        finally:
            ended = time.monotonic()
            await operator.end(signal.SIGKILL)
    return Told(hover, at, ended)


def sum_up(story: Story, told: Sequence[Told]) -> Row:
    """Figures of a story told some times."""
    broken = [rule for one in told for rule in story.broken(one)]
    return {
        "level_s": [round(one.level(), 3) for one in told],
        "released_s": [round(one.released(), 3) for one in told],
        "longest_gap_s": [round(one.gap(), 3) for one in told],
        "failsafes": [one.hover.seen.failsafes for one in told],
        "load": round(os.getloadavg()[0], 1),
        "broken": broken,
        "holds": not broken,
    }

"""`python -m lab fuzz --core`: random happenings around the flight core, and what must hold whatever happens.

`coreworld` has the toy aircraft, its client and what happens, `corejudge` what must never be. This module counts what
was reached of every closed set of the core, and shortens a sequence that breaks a promise.
"""

from __future__ import annotations

import random
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from lab.campaign import Campaign, CampaignError, Ending, Row
from lab.fuzz.corejudge import Breach, Judge
from lab.fuzz.coreworld import HAPPENINGS, Happening, World, carry, settle
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.config.control import ControlConfig, LeaseConfig, LimiterConfig
from mkdaemon.control.admission.beginnings import MANOEUVRES, Concern
from mkdaemon.control.admission.row import Rule
from mkdaemon.control.admission.rows import ROWS
from mkdaemon.control.events import Event
from mkdaemon.control.manoeuvres.by_target import SEARCHES
from mkdaemon.control.manoeuvres.land import LandingPhase
from mkdaemon.control.manoeuvres.pathflight import APPROACHES, FOLLOWS
from mkdaemon.control.manoeuvres.take_off import TakeOffPhase
from mkdaemon.telemetry.control import CauseKind, Outcome, Phase
from mkdaemon.telemetry.setpoint import SETPOINTS

EVENTS: Final = 300
"""Happenings of a sequence."""
PAUSES: Final = (0.0, 0.0, 0.0, 0.0, 0.05, 0.1)
"""After a happening [s]; 0: the next one comes before the core has ticked."""
LONG_PAUSES: Final = (*(5.0,) * 24, 100.0)
"""In which the client takes off or lands, or the aircraft is swung by hand [s]; the longest is one in which every
landing has to end."""
CALM: Final = (1, 1, 4, 15)
"""How much more often than `HAPPENINGS` says nothing happens; drawn for each sequence."""
BLOCK: Final = 50
"""Sequences of one line of the file of results."""
QUICK: Final = ControlConfig(
    limiter=LimiterConfig(setpoint_ttl=0.2),
    lease=LeaseConfig(engage_after=0.2, release_after=0.5, ttl=1.0),
    autopilot=AutopilotConfig(
        entry_clean=0.3,
        takeoff_ready=0.3,
        stand_time=0.3,
        arrived_for=0.3,
        search_after=0.4,
        level_after=0.6,
        exit_after=1.2,
        max_climb=1.0,
    ),
)
"""Times as short as they may be, so that much happens in a sequence."""
UNSAFE_LOOP: Final = ControlConfig(limiter=LimiterConfig(slew=20.0))
"""Limits with which the control loop is refused."""
CONFIGS: Final = (*(QUICK,) * 24, *(ControlConfig(),) * 3, UNSAFE_LOOP)
"""One is drawn for each sequence."""


def closed_sets() -> set[str]:
    """Everything that a campaign has to reach: phases, manoeuvres, stages, outcomes, causes, events, refusals.

    Of the table of admission those rows count that the core itself asks; a look at the client's way and at the work of
    the boards is added by the daemon.
    """
    about = {Concern.LEASE, *MANOEUVRES}
    rows = [row for row in ROWS if about & set(row.concerns) and row.rule not in (Rule.WAITS, Rule.ADVICE)]
    return {
        *(f"event {kind.__name__}" for kind in Event.__subclasses__()),
        *(f"phase {phase}" for phase in Phase),
        *(f"manoeuvre {kind.suffix.removeprefix('setpoint/')}" for kind in SETPOINTS),
        *(f"stage {stage}" for stage in (*LandingPhase, *TakeOffPhase, SEARCHES, APPROACHES, FOLLOWS)),
        *(f"outcome {outcome}" for outcome in Outcome),
        *(f"cause {kind}" for kind in CauseKind),
        *(f"refusal {token}" for row in rows if row.name not in BY_DAEMON for token in row.tokens),
        *(f"happening {happening.__name__}" for happening in HAPPENINGS),
    }


BY_DAEMON: Final = ("live set", "procedure under way", "way to the client")
"""Rows of the table that look at what the daemon adds to the question."""


def draw(seed: int, events: int = EVENTS) -> list[Happening]:
    """Draw a sequence; the same seed draws the same."""
    rng = random.Random(f"{seed} happenings")
    names, (calm, *others) = [each.__name__ for each in HAPPENINGS], HAPPENINGS.values()
    long = (settle.__name__, carry.__name__)
    weights = (calm * rng.choice(CALM), *others)
    return [
        Happening(name, rng.getrandbits(32), rng.choice(LONG_PAUSES if name in long else PAUSES))
        for name in rng.choices(names, weights, k=events)
    ]


def run(seed: int, happenings: Sequence[Happening]) -> tuple[list[str], Counter[str]]:
    """Let things happen around a core, and judge every tick.

    Returns:
        What was broken, each with the time and what was seen; and what was reached, counted: the closed sets, `tick`,
        and `in flight`, the ticks in which stick frames were sent.
    """
    by_name, rng = {each.__name__: each for each in HAPPENINGS}, random.Random(f"{seed} world")
    world = World(rng, rng.choice(CONFIGS))
    judge = Judge(world)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for what, number, pause in happenings:
                details = random.Random(number)
                by_name[what](world, details)
                world.reached[f"happening {what}"] += 1
                while pause > 0.0:
                    step = min(pause, world.longest_step)
                    world.go_on(details, step)
                    _tick(world, judge, details)
                    pause -= step
    except Exception:  # whatever it is, it is the finding  # noqa: BLE001
        judge.breach(Breach.EXCEPTION, traceback.format_exc(limit=-4))
    return judge.breaches, world.reached


def _tick(world: World, judge: Judge, rng: random.Random) -> None:
    """Tick as often as the core asks for it, carry out what it decides, and judge."""
    for _ in range(3):
        if world.core.next_time() > world.now:
            return
        actions = world.core.tick(world.now)
        judge.look(actions)
        world.carry_out(actions, rng)


def shortened(seed: int, events: int = EVENTS) -> list[Happening]:
    """The shortest sequence found that breaks the same promise first as that of a seed does (delta debugging).

    Raises:
        IndexError: the sequence breaks none.
    """
    kept, part = draw(seed, events), events // 2
    wanted = run(seed, kept)[0][0].partition(" ")[0]
    while part:
        for start in range(len(kept) - part, -part, -part):
            fewer = kept[: max(start, 0)] + kept[max(start, 0) + part :]
            if any(broken.startswith(f"{wanted} ") for broken in run(seed, fewer)[0][:1]):
                kept = fewer
        part //= 2
    return kept


def _run_block(first: int) -> Row:
    reached, breaches = Counter[str](), dict[int, list[str]]()
    for seed in range(first, first + BLOCK):
        broken, more = run(seed, draw(seed))
        reached += more
        breaches |= {seed: broken} if broken else {}
    why = next((f"{seed}: {broken[0]}" for seed, broken in breaches.items()), "")
    return {"ending": Ending.WRONG if why else Ending.FINISHED, "why": why, "breaches": breaches, "reached": reached}


BLOCKS: Final = Campaign("fuzz core", _run_block, lambda first: {"first": first})


def run_sequences(first: int, count: int, jobs: int, results: Path | None = None) -> Row:
    """Run so many sequences, rounded up to whole blocks, which are kept in a file of results.

    Returns:
        How many `sequences`; `breaches` by seed; what was `reached`, counted, and `unreached` of the closed sets.

    Raises:
        CampaignError: a block could not be run.
    """
    reached, breaches = Counter[str](), dict[int, list[str]]()
    rows = BLOCKS.rows(range(first, first + count, BLOCK), jobs, results)
    for row in rows:
        if row["ending"] == Ending.FAILED:
            raise CampaignError(f"the block from {row['first']} on: {row['why']}")
        reached += Counter(row["reached"])
        breaches |= {int(seed): broken for seed, broken in row["breaches"].items()}
    unreached = sorted(closed_sets() - reached.keys())
    return {"sequences": BLOCK * len(rows), "breaches": breaches, "reached": reached, "unreached": unreached}

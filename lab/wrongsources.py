"""Sources of poses that go wrong, drawn from seeds, in virtual time: `python -m lab wrong-sources`.

Each flight draws a fault, its size, its begin (on the ground, in the hold, in a goto, on a path, in the landing), the
wind, and whether a camera or a second motion capture system is flown by as well. Physics and wire are the judges. What
is promised: docs/lab/positions.md, "Wrong sources".
"""

from __future__ import annotations

import math
from bisect import bisect
from typing import Final

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, summed_up
from lab.positions import VOLUME
from lab.rigs.positionflight import LAND_AT, LOOK
from lab.rigs.wrongsourceflight import Moment, WrongSource, WrongSourceFlight, drawn
from lab.tables import show
from mkdaemon.cli.arguments import AsJson

AT_ONCE: Final = ("silent", "late", "frozen", "off", "other_body", "neighbour", "wrong_up")
"""Faults that show without the aircraft's motion when they begin in flight."""
SEEN_ON_GROUND: Final = ("silent", "late", "frozen", "wrong_up")
"""Those that show on the ground."""
NAMED_IN_FLIGHT, NAMED_ON_GROUND = 1.0, 3.0
"""Time within which they are named [s]."""
USED_AFTER: Final = 0.2
"""Poses under way when a source is named [s]. One that was silent is used when it is back: late without saying so, it
begins with a silence."""
RELEASED_AFTER: Final = 3.5
"""An aircraft whose only source stays named is released within this time [s]."""
MOVED_BY_MOTION: Final = 1.5
"""A source that only the motion of the aircraft shows moves it no farther out of where it flies, before and after it is
named [m]."""
MOVED: Final = 0.5
"""The same of the others [m]; light wind is included. Alone, until it is used no more: in the 3 s to the release the
aircraft flies on as after a silence."""
ON_PAD: Final = 0.3
"""A landing this near to the middle of the pad is where it was to be [m]."""


def fly(plan: WrongSource) -> Row:
    """Fly once.

    Returns:
        Its ending and why; `named` after the begin of the fault [s], None where it was not; by which `words`; how far
        out of the flown rectangle the aircraft `moved` [m]; `touch_cm`; why it was `released`.
    """
    rig = WrongSourceFlight(plan)
    record, truth = rig.fly(), rig.world_truth
    named_at, words = rig.named_by
    farthest = max((math.hypot(*place[:2]) for place in record.positions), default=0.0)
    has_landed = record.touched > LAND_AT and record.stands
    row: Row = {
        "named": max(0.0, named_at - plan.at),
        "words": words,
        "moved": rig.moved,
        "touch_cm": 100.0 * record.touch_error if has_landed else None,
        "released": rig.released[0][1] if rig.released else "",
    }
    lost = record.lost or truth.crash_reason or (f"{farthest:.1f} m away" if farthest > VOLUME else "")
    if lost:
        return row | {"ending": Ending.LOST, "why": lost}
    wrong = _broken(plan, rig, named_at, has_landed=has_landed)
    if wrong:
        return row | {"ending": Ending.WRONG, "why": wrong}
    if not rig.has_flown:
        return row | {"ending": Ending.REFUSED, "why": words}
    if rig.released and not has_landed:
        # Alone, that is what is promised; beside another eye it is safe, but the other could have been flown by.
        return row | {"ending": Ending.RELEASED if plan.other else Ending.FINISHED, "why": row["released"]}
    return row | {"ending": Ending.FINISHED, "why": ""}


def _broken(plan: WrongSource, rig: WrongSourceFlight, named_at: float, *, has_landed: bool) -> str:
    """Which promise was broken; empty for none."""
    if rig.accused:
        return f"the other source was named: {rig.accused[0][2]}"
    is_unseen = math.isinf(named_at)
    off_by = math.hypot(*plan.size.offset[:2]) if plan.fault == "off" and is_unseen else 0.0
    is_ground = plan.moment is Moment.GROUND
    is_promised = plan.fault in (SEEN_ON_GROUND if is_ground else AT_ONCE)
    led = rig.moved if plan.other else rig.led
    if led > (MOVED if is_promised else MOVED_BY_MOTION):
        return f"led {led:.2f} m away"
    if has_landed and rig.record.touch_error > ON_PAD + off_by:
        return f"landed {rig.record.touch_error:.2f} m beside the pad"
    if rig.record.times and plan.at > rig.record.times[-1]:
        return ""
    within = NAMED_ON_GROUND if is_ground else NAMED_IN_FLIGHT
    if is_promised and named_at > plan.at + within and not has_landed:
        return "not named" if is_unseen else f"named after {named_at - plan.at:.1f} s"
    if not plan.other and was_used_while_named(rig):
        return "used while it was named"
    let_go = rig.released[0][0] if rig.released else math.inf
    if not plan.other and rig.has_flown and not has_landed and let_go > named_since(rig, let_go) + RELEASED_AFTER:
        return "not released"
    return ""


def named_since(rig: WrongSourceFlight, until: float) -> float:
    """Since when every look until a time [s] has named the source [s]: one that was silent is used when it is back."""
    looks = [at for at, *_ in rig.named if at <= until]
    if not looks and math.isfinite(until):
        return until  # the release was sooner than the next look
    since = looks[-1:] or [rig.plan.at]
    for at in reversed(looks[:-1]):
        if since[0] - at > 1.5 * LOOK:
            break
        since[0] = at
    return since[0]


def was_used_while_named(rig: WrongSourceFlight) -> bool:
    """Whether a pose was used between two looks that both found the source wrong, and some time after the first."""
    looks = [at for at, *_ in rig.named]
    for at in rig.used:
        next_look = bisect(looks, at)
        since = looks[bisect(looks, at - USED_AFTER) : next_look]
        if len(since) >= round(USED_AFTER / LOOK) and next_look < len(looks) and looks[next_look] < at + LOOK:
            return True
    return False


def _key(plan: WrongSource) -> Row:
    return {"seed": plan.seed, "wind": plan.wind.value, "fault": plan.fault, "moment": plan.moment.value} | {
        "at": plan.at,
        "other": plan.other,
        "is_first": plan.is_first,
    }


FLIGHTS: Final = Campaign("wrong-sources", fly, _key, limit=300.0)


def main(*, seeds: int = 200, first: First = 1, jobs: Jobs = 2, results: Kept = None, as_json: AsJson = False) -> int:
    """Fly with sources that go wrong; five to ten seconds of processor time a flight.

    Args:
        seeds: flights.
    """
    rows = FLIGHTS.rows([drawn(seed) for seed in range(first, first + seeds)], jobs, results)
    found = []
    for other, what in (("", "alone"), ("down", "beside a camera"), ("second", "beside a second source")):
        part = [row for row in rows if row["other"] == other]
        holds = not any(row["ending"] in {Ending.WRONG, Ending.LOST, Ending.FAILED} for row in part)
        unnamed = sum(row.get("named") is None for row in part)
        found.append({"what": what} | summed_up(part, "named", "moved") | {"unnamed": unnamed, "holds": holds})
    return show([row for row in found if row["flights"]], ("what", "flights"), as_json=as_json)

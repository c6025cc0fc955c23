"""A thousand lost clients summed up: percentiles, worst cases, and which ones broke a limit."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import structlog

from lab.campaign import in_order
from lab.rigs.cockpit import Boards
from lab.stories.deaths import NEUTRAL_TIME, SESSION, WATCH, Loss, fly_session
from mkdaemon.link.link import Link


@dataclass(frozen=True, slots=True)
class Losses:
    """What a campaign of deaths showed; times from the last usable setpoint [ms].

    Attributes:
        boards: which aircraft.
        runs: deaths.
        ways: how many of each kind.
        wire_p50_ms: neutral sticks on the wire, median.
        wire_p999_ms: 99.9th percentile.
        wire_max_ms: longest.
        neutral_max_ms: neutral in the FlightCtrl, longest.
        applied_max_ms: neutral at the mixer, longest; it samples every 22.5 ms.
        released_max_ms: Config cleared in the FlightCtrl, longest; None where one never was.
        never_neutral: deaths after which no neutral frame came.
        never_released: deaths after which the FlightCtrl held a command to the end.
        relapses: frames that steered after the release had begun.
        wrong: session and number of every death that broke a limit.
    """

    boards: str
    runs: int
    ways: dict[str, int]
    wire_p50_ms: float | None
    wire_p999_ms: float | None
    wire_max_ms: float | None
    neutral_max_ms: float | None
    applied_max_ms: float | None
    released_max_ms: float | None
    never_neutral: int
    never_released: int
    relapses: int
    wrong: list[tuple[int, int]]

    @property
    def holds(self) -> bool:
        """Whether every limit holds."""
        late = self.wire_p999_ms is None or self.wire_p999_ms > 1000 * NEUTRAL_TIME
        return not (late or self.wrong or self.never_neutral)


def campaign(
    boards: Boards,
    runs: int,
    *,
    jobs: int = 1,
    first_seed: int = 1,
    link_class: type[Link] = Link,
    watched: float = WATCH,
) -> Losses:
    """Lose so many clients, in sessions of `SESSION`, and sum up."""
    fly = partial(_fly, boards, link_class, watched)
    flown = in_order(fly, list(enumerate(sessions(runs, SESSION), first_seed)), jobs)
    return summed_up(boards.name, [loss for losses in flown for loss in losses])


def _fly(boards: Boards, link_class: type[Link], watched: float, session: tuple[int, int]) -> list[Loss]:
    """Fly a session with a seed and a number of deaths."""
    silence_log()
    return fly_session(boards, *session, link_class=link_class, watched=watched)


def sessions(runs: int, size: int) -> list[int]:
    """Runs of each session: `size`, and in the last one what is left."""
    return [min(size, runs - done) for done in range(0, runs, size)]


def summed_up(name: str, found: list[Loss]) -> Losses:
    """Percentiles and worst cases of many deaths."""
    wire = sorted(loss.wire for loss in found if loss.wire is not None)
    return Losses(
        boards=name,
        runs=len(found),
        ways=dict(sorted(Counter(str(loss.death) for loss in found).items())),
        wire_p50_ms=_ms(percentile(wire, 0.5)),
        wire_p999_ms=_ms(percentile(wire, 0.999)),
        wire_max_ms=_ms(wire[-1] if wire else None),
        neutral_max_ms=_ms(_longest(loss.neutral for loss in found)),
        applied_max_ms=_ms(_longest(loss.applied for loss in found)),
        released_max_ms=_ms(_longest(loss.released for loss in found)),
        never_neutral=sum(loss.wire is None for loss in found),
        never_released=sum(loss.released is None for loss in found),
        relapses=sum(loss.relapses for loss in found),
        wrong=[(loss.seed, loss.number) for loss in found if loss.is_wrong],
    )


def percentile(ordered: list[float], share: float) -> float | None:
    """The smallest value that this share of all does not exceed; None of nothing."""
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else None


def _longest(times: Iterable[float | None]) -> float | None:
    return max((time for time in times if time is not None), default=None)


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000 * seconds, 1)


def silence_log() -> None:
    """Every death is a line in the daemon's log; a thousand of them are a bench's."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))

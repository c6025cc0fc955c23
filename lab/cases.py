"""Campaigns of several cases, each with its flights, the figures of a group of them, and limits that each keeps."""

from __future__ import annotations

import asyncio
import inspect
import logging
import math
import os
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Final

import structlog
from cyclopts import Parameter

from lab.campaign import Campaign, Ending, First, Jobs, Row
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError

Figure = Callable[[Sequence[Row]], Any]
"""One figure of the results of a group."""
SHOWN: Final = 200
"""Characters of a wrong result that the progress shows."""


def judged(limits: Mapping[str, float | str], **found: Any) -> Row:
    """What became of a flight, and `is_wrong`: whether it breaks a limit.

    Args:
        limits: by the name of what was found: of a number or a claim the largest that is right, of a word the word;
            None, for what never was, breaks any.
        found: all of it.
    """
    return found | {"is_wrong": not all(_keeps(found[name], limit) for name, limit in limits.items())}


def _keeps(value: Any, limit: float | str) -> bool:
    return bool(value == limit if isinstance(limit, str) else value is not None and value <= limit)


@dataclass(frozen=True, slots=True)
class Flight:
    """What is flown once.

    Attributes:
        what: is done to it.
        boards: which aircraft.
        fly: flies with a seed, as a function or a coroutine, and returns a row with `is_wrong` (see `judged`), or a
            list of them; made of functions of modules, so that another process finds it.
        seed: of everything random.
    """

    what: str
    boards: str
    fly: Callable[[int], Any]
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Case:
    """A part of a campaign.

    Attributes:
        flights: that are flown, by the number of runs, where one is asked for, and the first seed.
        figures: of the results of a group: of flights with the same `what` and boards.
        is_alone: one flight at a time: it is the machine's load itself.
        longest: a flight of real time that takes longer has failed [s].
        holds: whether a group is right, by its boards and its results.
    """

    flights: Callable[[int | None, int], Sequence[Flight]]
    figures: Mapping[str, Figure]
    is_alone: bool = False
    longest: float = 300.0
    holds: Callable[[str, Sequence[Row]], bool] = lambda boards, found: not any(one["is_wrong"] for one in found)


def key_of(case: str, flight: Flight) -> Row:
    """What a flight of a case is kept under."""
    return {"case": case, "what": flight.what, "boards": flight.boards, "seed": flight.seed}


def fly(longest: float, flight: Flight) -> Row:
    """Fly once, for so long at most [s]; the row has all that was found."""
    silence_log()
    found = flight.fly(flight.seed)
    if inspect.iscoroutine(found):
        found = asyncio.run(_in_time(found, longest))
    every = found if isinstance(found, list) else [found]
    wrong = [one for one in every if one["is_wrong"]]
    why = str(wrong[0])[:SHOWN] if wrong else ""
    load = round(os.getloadavg()[0], 1)
    return {"ending": Ending.WRONG if wrong else Ending.FINISHED, "why": why, "load": load, "found": every}


async def _in_time(flight: Coroutine[Any, Any, Any], longest: float) -> Any:
    async with asyncio.timeout(longest):
        return await flight


def carry_out(
    campaign: str,
    cases: Mapping[str, Case],
    chosen: str | None = None,
    runs: int | None = None,
    *,
    first: int = 1,
    jobs: int = 1,
    only: str = "",
    as_json: bool = False,
) -> int:
    """Carry out cases and show their groups.

    Args:
        campaign: its name, in a file of results.
        cases: that it has.
        chosen: one of them; all by default.
        runs: of every group, in place of each case's own.
        first: seed.
        jobs: flights at a time.
        only: groups whose `what` and boards hold this.
        as_json: one object in place of a table.

    Returns:
        Exit code: 1 where a group does not hold.

    Raises:
        ConfigError: there is no such case.
    """
    if chosen is not None and chosen not in cases:
        raise ConfigError(f"no case {chosen!r}: choose from {', '.join(cases)}")
    rows: list[Row] = []
    for name in cases if chosen is None else (chosen,):
        case = cases[name]
        flights = [one for one in case.flights(runs, first) if only in f"{one.what}, {one.boards}"]
        flying = Campaign(campaign, partial(fly, case.longest), partial(key_of, name))
        rows += groups(case, flying.rows(flights, 1 if case.is_alone else jobs))
    return show(rows, ("case", "what", "boards", "runs"), as_json=as_json)


def command(
    campaign: str, cases: Mapping[str, Case], about: str, runs: int | None = None, first: int = 1
) -> Callable[..., int]:
    """The `main` of a campaign of cases.

    Args:
        campaign: its name, in a file of results.
        cases: that it has.
        about: the help: what it does, and for how long.
        runs: of every group, unless asked for otherwise; None for each case's own number.
        first: seed likewise.
    """

    def main(
        *,
        case: Annotated[str | None, Parameter(help="One case; all by default.")] = None,
        runs: Annotated[int | None, Parameter(help="Runs of every row, in place of each case's own.")] = runs,
        first: First = first,
        only: Annotated[str, Parameter(help="Only rows whose words, 'daemon killed, FC 2.08', hold this.")] = "",
        jobs: Jobs = 1,
        as_json: AsJson = False,
    ) -> int:
        return carry_out(campaign, cases, case, runs, first=first, jobs=jobs, only=only, as_json=as_json)

    main.__doc__ = about
    return main


def groups(case: Case, flown: Sequence[Row]) -> Iterator[Row]:
    """A row for each group of flights; one that could not be flown is as wrong as one that breaks a limit."""
    for what, boards in dict.fromkeys((row["what"], row["boards"]) for row in flown):
        group = [row for row in flown if (row["what"], row["boards"]) == (what, boards)]
        found = [one for row in group for one in row.get("found", ())]
        failed = [f"{row['seed']}: {row['why']}" for row in group if row["ending"] == Ending.FAILED]
        yield {
            "case": group[0]["case"],
            "what": what,
            "boards": boards,
            "runs": len(found) + len(failed),
            **{name: figure(found) for name, figure in case.figures.items()},
            "failed": failed,
            "wrong": [one for one in found if one["is_wrong"]],
            "holds": not failed and case.holds(boards, found),
        }


def sessions(runs: int, size: int) -> list[int]:
    """Runs of each session: `size`, and in the last one what is left."""
    return [min(size, runs - done) for done in range(0, runs, size)]


def silence_log() -> None:
    """Every death is a line in the daemon's log; a thousand of them are a bench's."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))


# -- figures of a group -----------------------------------------------------------------------------------------------


def percentile(ordered: Sequence[float], share: float) -> float | None:
    """The smallest value that this share of all does not exceed; None of nothing."""
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else None


def part(name: str, share: float) -> Figure:
    """A percentile of what was found under a name, where it is known."""
    return lambda found: percentile(sorted(one[name] for one in found if one[name] is not None), share)


def largest(name: str) -> Figure:
    """The largest of it."""
    return part(name, 1.0)


def total(name: str) -> Figure:
    """The sum of it; of claims how many hold."""
    return lambda found: sum(one[name] for one in found)


def each(name: str) -> Figure:
    """All of it."""
    return lambda found: [one[name] for one in found]

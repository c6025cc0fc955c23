"""Flights of a long campaign: each is told when it ends, and one that fails costs no other its result."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Generic, Protocol, TypeVar

from lab.campaign import in_order, place_of
from lab.stories.losses import silence_log

LONGEST: Final = 300.0
"""A flight that takes longer has failed [s]; the longest on an idle machine takes 15."""


class Flight(Protocol):
    """What a flight came to."""

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""


AnyFlight = TypeVar("AnyFlight", bound=Flight)


@dataclass(frozen=True, slots=True)
class Plan(Generic[AnyFlight]):
    """Flights of one row of the campaign, before they are flown.

    Attributes:
        attack: what is done to them.
        boards: which aircraft.
        fly: flies with a seed; a function of a module, so that another process finds it.
    """

    attack: str
    boards: str
    fly: Callable[[int], Coroutine[Any, Any, AnyFlight]]


@dataclass(slots=True)
class Flights(Generic[AnyFlight]):
    """Flights of one row of the campaign.

    Attributes:
        attack: what was done to them.
        boards: which aircraft.
        flown: what came of those that were flown.
        not_flown: seed and reason of those that were not; each of them fails the row.
    """

    attack: str
    boards: str
    flown: list[AnyFlight] = field(default_factory=list)
    not_flown: list[dict[str, Any]] = field(default_factory=list)


def fly_all(plans: Sequence[Plan[AnyFlight]], seeds: range, jobs: int = 1) -> Iterator[Flights[AnyFlight]]:
    """Fly every plan once per seed, and write on standard error how each flight went.

    Args:
        plans: the rows.
        seeds: one per flight.
        jobs: flights at a time. Every flight has processes, ports, a folder and boards of its own, and one process
            judges it alone: they share nothing but the machine.

    Yields:
        What came of each plan, in their order.
    """
    if jobs <= 1:  # a row is known as soon as its flights have ended
        for plan in plans:
            yield _put_together(plan, [_fly_once((plan, seed)) for seed in seeds])
        return
    # The same seed of all rows first: flights at a time are different ones.
    found = in_order(_fly_once, [(plan, seed) for seed in seeds for plan in plans], jobs)
    for number, plan in enumerate(plans):
        yield _put_together(plan, found[number :: len(plans)])


def _put_together(plan: Plan[AnyFlight], parts: Sequence[Flights[AnyFlight]]) -> Flights[AnyFlight]:
    flown = [one for part in parts for one in part.flown]
    return Flights(plan.attack, plan.boards, flown, [one for part in parts for one in part.not_flown])


def _fly_once(asked: tuple[Plan[AnyFlight], int]) -> Flights[AnyFlight]:
    silence_log()
    plan, seed = asked
    flights = Flights[AnyFlight](plan.attack, plan.boards)
    began = time.monotonic()
    try:
        flight = asyncio.run(_fly_in_time(plan.fly(seed)))
    except Exception as error:  # noqa: BLE001
        # Whatever keeps one flight from being flown, the others count; and the row fails.
        reason = f"{type(error).__name__}: {error} ({place_of(error)})"
        flights.not_flown.append({"seed": seed, "reason": reason})
        outcome = f"NOT FLOWN: {reason}"
    else:
        flights.flown.append(flight)
        outcome = f"WRONG: {flight}" if flight.is_wrong else "holds"
    took, load = time.monotonic() - began, os.getloadavg()[0]
    where = f"{plan.attack}, {plan.boards}, seed {seed}"
    print(f"{where}: {outcome} ({took:.0f} s, load {load:.1f})", file=sys.stderr, flush=True)
    return flights


async def _fly_in_time(flight: Coroutine[Any, Any, AnyFlight]) -> AnyFlight:
    async with asyncio.timeout(LONGEST):
        return await flight

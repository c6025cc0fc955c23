"""Flights of a long campaign: each is told when it ends, and one that fails costs no other its result."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, Final, Generic, Protocol, TypeVar

LONGEST: Final = 120.0
"""A flight that takes longer has failed [s]; the longest on an idle machine takes 15."""


class Flight(Protocol):
    """What a flight came to."""

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""


_Flight = TypeVar("_Flight", bound=Flight)


@dataclass(slots=True)
class Flights(Generic[_Flight]):
    """Flights of one row of the campaign.

    Attributes:
        attack: what was done to them.
        boards: which aircraft.
        flown: what came of those that were flown.
        not_flown: seed and reason of those that were not; each of them fails the row.
    """

    attack: str
    boards: str
    flown: list[_Flight] = field(default_factory=list)
    not_flown: list[dict[str, Any]] = field(default_factory=list)


def fly_all(
    attack: str, boards: str, seeds: range, fly: Callable[[int], Coroutine[Any, Any, _Flight]]
) -> Flights[_Flight]:
    """Fly once per seed, and tell on standard error how each went.

    Args:
        attack: what is done to them.
        boards: which aircraft.
        seeds: one per flight.
        fly: flies with a seed.
    """
    flights = Flights[_Flight](attack, boards)
    for number, seed in enumerate(seeds, 1):
        began = time.monotonic()
        try:
            flight = asyncio.run(_fly_in_time(fly(seed)))
        except Exception as error:  # noqa: BLE001
            # Whatever keeps one flight from being flown, the others count; and the row fails.
            reason = f"{type(error).__name__}: {error}"
            flights.not_flown.append({"seed": seed, "reason": reason})
            outcome = f"NOT FLOWN: {reason}"
        else:
            flights.flown.append(flight)
            outcome = f"WRONG: {flight}" if flight.is_wrong else "holds"
        took, load = time.monotonic() - began, os.getloadavg()[0]
        where = f"{attack}, {boards}, {number} of {len(seeds)}, seed {seed}"
        print(f"{where}: {outcome} ({took:.0f} s, load {load:.1f})", file=sys.stderr, flush=True)
    return flights


async def _fly_in_time(flight: Coroutine[Any, Any, _Flight]) -> _Flight:
    async with asyncio.timeout(LONGEST):
        return await flight

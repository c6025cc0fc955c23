"""Vision campaigns cut into parts, which give the same figures in any number of processes.

A part draws everything from its own seeds and needs nothing from the others; the results are put together in the order
of the plan.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2

from lab.campaign import each_result, minutes
from lab.vision.stills import SeedSet

PROGRESS_EVERY: Final = 10.0
"""Progress is written at most this often [s]."""


@dataclass(frozen=True, slots=True)
class Part:
    """A piece of a case.

    Attributes:
        work: a function of a module, so that another process finds it.
        args: what it is called with.
        images: how many it looks at.
    """

    work: Callable[..., Any]
    args: tuple[Any, ...]
    images: int

    def run(self) -> Any:
        """Do it here."""
        cv2.setNumThreads(1)
        return self.work(*self.args)


@dataclass(frozen=True, slots=True)
class Case:
    """One campaign.

    Attributes:
        plan: its parts; called with `quick` and the seeds.
        sum_up: figures from `quick`, the parts and their results in the same order.
    """

    plan: Callable[[bool, SeedSet], list[Part]]
    sum_up: Callable[[bool, Sequence[Part], Sequence[Any]], dict[str, Any]]


def in_parts(count: int, size: int) -> list[tuple[int, int]]:
    """Cut `count` images into parts of `size`: number of the part and its images."""
    return [(k, min(size, count - k * size)) for k in range(-(-count // size))]


def run_parts(name: str, parts: Sequence[Part], jobs: int) -> list[Any]:
    """Run parts, one here or several in processes of their own, with their progress on stderr.

    Args:
        name: for the progress.
        parts: in any number.
        jobs: processes at most.

    Returns:
        Results in the order of the parts.

    Raises:
        CampaignError: a process died.
    """
    found, began, written = {}, time.monotonic(), 0.0
    for number, result in each_result(Part.run, parts, jobs):
        found[number] = result
        passed = time.monotonic() - began
        if passed - written >= PROGRESS_EVERY:
            written, left = passed, passed * (len(parts) - len(found)) / len(found)
            print(f"{name}: {len(found)} of {len(parts)} parts, {minutes(left)} left", file=sys.stderr, flush=True)
    return [found[number] for number in range(len(parts))]

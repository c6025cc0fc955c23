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
    progress, found = Progress(name, sum(part.images for part in parts)), {}
    for number, result in each_result(Part.run, parts, jobs):
        found[number] = result
        progress.add(parts[number].images)
    return [found[number] for number in range(len(parts))]


class Progress:
    """How far the images of a case are and when they will end, on stderr.

    Args:
        name: of the case.
        total: images.
        clock: gives the time [s].
    """

    def __init__(self, name: str, total: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._name, self._total = name, total
        self._clock = clock
        self._start = self._written = clock()
        self._done = 0

    def add(self, images: int) -> None:
        """Some more are done."""
        self._done += images
        now = self._clock()
        if now - self._written >= PROGRESS_EVERY:
            self._written = now
            print(self.line(now), file=sys.stderr, flush=True)

    def line(self, now: float) -> str:
        """The words for a time [s]."""
        left = (now - self._start) * (self._total - self._done) / max(self._done, 1)
        share = 100 * self._done // max(self._total, 1)
        return f"{self._name}: {self._done} of {self._total} images, {share} %, {minutes(left)} left"

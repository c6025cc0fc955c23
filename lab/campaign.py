"""Campaigns cut into parts that run in several processes and give the same figures in any number of them.

A part draws everything from its own seeds and needs nothing from the others; the results are put together in the order
of the plan, whichever process was first.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import cv2

from lab.vision.stills import SeedSet
from mkdaemon.errors import VisionError

TELL_EVERY: Final = 10.0
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
    """Run parts, one here or several in processes of their own, and tell how far they are.

    Args:
        name: for the progress on stderr.
        parts: in any number.
        jobs: processes at most.

    Returns:
        Results in the order of the parts.

    Raises:
        VisionError: a process died.
    """
    progress = Progress(name, sum(part.images for part in parts))
    if min(jobs, len(parts)) <= 1:
        results = []
        for part in parts:
            results.append(part.run())
            progress.add(part.images)
        return results
    with (
        _one_thread_each(),
        ProcessPoolExecutor(min(jobs, len(parts)), multiprocessing.get_context("spawn"), initializer=_begin) as pool,
    ):
        futures: dict[Future[Any], Part] = {pool.submit(part.run): part for part in parts}
        try:
            for future in as_completed(futures):
                future.result()
                progress.add(futures[future].images)
        except BrokenProcessPool:
            msg = f"bench vision: a process of case '{name}' died, perhaps for want of memory; use fewer --jobs"
            raise VisionError(msg) from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]


def _begin() -> None:
    """First thing in a new process: Ctrl-C is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started meanwhile let numpy's libraries start no threads of their own."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class Progress:
    """How far a case is and when it will end, on stderr.

    Args:
        name: of the case.
        total: images.
        clock: gives the time [s].
    """

    def __init__(self, name: str, total: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._name = name
        self._total = total
        self._clock = clock
        self._start = self._told = clock()
        self._done = 0

    def add(self, images: int) -> None:
        """Some more are done."""
        self._done += images
        now = self._clock()
        if now - self._told >= TELL_EVERY:
            self._told = now
            print(self.line(now), file=sys.stderr, flush=True)

    def line(self, now: float) -> str:
        """What to say at a time [s]."""
        left = (now - self._start) * (self._total - self._done) / max(self._done, 1)
        share = 100 * self._done // max(self._total, 1)
        return f"{self._name}: {self._done} of {self._total} images, {share} %, {_minutes(left)} left"


def _minutes(seconds: float) -> str:
    """As 1:05."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"

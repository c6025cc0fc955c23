"""Waiting for something to become true, work beside it, and work in virtual time."""

from __future__ import annotations

import asyncio
import functools
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, Final, ParamSpec, TypeVar

from mkdaemon.virtualtime import run_virtually

if TYPE_CHECKING:
    from mkdaemon.client import Sample, Vehicle

PATIENCE: Final = 30.0
"""Longest wait for what takes two seconds on an idle machine [s]: what takes longer is broken."""

_Found = TypeVar("_Found")
_Given = ParamSpec("_Given")


def in_virtual_time(work: Callable[_Given, Coroutine[Any, Any, _Found]]) -> Callable[_Given, _Found]:
    """A function that runs a coroutine function to its end in virtual time."""

    @functools.wraps(work)
    def run(*args: _Given.args, **kwargs: _Given.kwargs) -> _Found:
        return run_virtually(work(*args, **kwargs))

    return run


async def wait_until(claim: Callable[[], Any], within: float = PATIENCE, step: float = 0.002) -> float:
    """Wait until a claim holds, in the time of the running loop.

    Args:
        within: longest wait [s].

    Returns:
        How long it took [s].

    Raises:
        TimeoutError: it did not hold in time.
    """
    loop = asyncio.get_running_loop()
    start = loop.time()
    await wait_for(claim, within, step)
    return loop.time() - start


async def wait_for(find: Callable[[], _Found], within: float = PATIENCE, step: float = 0.002) -> _Found:
    """Wait until a function returns something that counts as true, and return it; see `wait_until`.

    Raises:
        TimeoutError: it returned nothing in time.
    """
    loop = asyncio.get_running_loop()
    end = loop.time() + within
    while not (found := find()):
        if loop.time() > end:
            msg = f"not within {within:g} s"
            raise TimeoutError(msg)
        await asyncio.sleep(step)
    return found


async def wait_for_blocking(find: Callable[[], _Found], within: float = PATIENCE, step: float = 0.05) -> _Found:
    """Wait until a function that blocks, and runs in a thread for that, returns something; see `wait_for`.

    Raises:
        TimeoutError: it returned nothing in time.
    """
    async with asyncio.timeout(within):
        while not (found := await asyncio.to_thread(find)):  # noqa: ASYNC110 - another thread finds it
            await asyncio.sleep(step)
    return found


@asynccontextmanager
async def running(work: Coroutine[Any, Any, Any]) -> AsyncIterator[asyncio.Task[Any]]:
    """Do some work beside the context, and cancel it at the context's end; how it ended does not matter."""
    task = asyncio.create_task(work)
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@asynccontextmanager
async def following(client: Vehicle, take: Callable[[Sample], object], *keys: str) -> AsyncIterator[None]:
    """Hand every value of some keys to a function while the context lasts."""
    async with client.watch(*keys) as samples:

        async def listen() -> None:
            async for sample in samples:
                take(sample)

        async with running(listen()):
            yield


def wait_blocking(claim: Callable[[], Any], within: float = PATIENCE, step: float = 0.01) -> None:
    """Wait until a claim holds, without a loop: for what other threads and processes do.

    Raises:
        TimeoutError: it did not hold in time.
    """
    end = time.monotonic() + within
    while not claim():
        if time.monotonic() > end:
            msg = f"not within {within:g} s"
            raise TimeoutError(msg)
        time.sleep(step)

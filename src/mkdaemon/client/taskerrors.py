"""Work beside other work, and the error that ended a group of tasks as the one line that a user reads."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

from mkdaemon.errors import MkError


@contextmanager
def single_error() -> Iterator[None]:
    """Raise the first error of a group of tasks in place of the group; a defect keeps its group and its traceback.

    Raises:
        MkError: the first one of a group in which all are such errors.
    """
    try:
        yield
    except BaseExceptionGroup as group:
        known, others = group.split(MkError)
        if known is None or others is not None:
            raise
        error: BaseException = known
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        raise error from None


@asynccontextmanager
async def beside(*work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Do other work while the context lasts; what fails in it ends the context.

    Raises:
        MkError: the first failure.
    """
    with single_error():
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(one) for one in work]
            yield
            for task in tasks:
                task.cancel()


@asynccontextmanager
async def background(*work: Coroutine[Any, Any, object]) -> AsyncIterator[tuple[asyncio.Task[object], ...]]:
    """Do other work while the context lasts; what fails in it ends nothing."""
    tasks = tuple(asyncio.create_task(one) for one in work)
    try:
        yield tasks
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

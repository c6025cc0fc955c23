"""Who acts on the event loop: the part of the daemon that a replay runs again is told apart from everything else.

The flight core, the line, procedures and requests decide by the time they see on the clock. A recording keeps what each
of them saw, by the name of its task; see `Clock.now` and docs/replay.md.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import Any, Final, ParamSpec, TypeVar

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

CALLBACK: Final = ""
"""Actor of a timer that belongs to no task."""
INPUT: Final = "input"
"""Actor of what comes from outside and is taken at once: setpoints, clients, the guard."""
_BY_TASK: Final = "task"
_ACTING: ContextVar[str | None] = ContextVar("acting", default=None)
"""None outside of the part that is replayed. Tasks and timers inherit it; threads do not."""


def current_actor() -> str | None:
    """Who acts now: the name of the running task, `CALLBACK` or `INPUT`; None for who is not replayed."""
    acting = _ACTING.get()
    if acting != _BY_TASK:
        return acting
    task = asyncio.current_task()
    return CALLBACK if task is None else task.get_name()


async def act(work: Coroutine[Any, Any, _Result]) -> _Result:
    """Do work in a task of its own that a replay runs again; its children are too."""
    _ACTING.set(_BY_TASK)
    return await work


@contextmanager
def acting(name: str) -> Iterator[None]:
    """Lend the running task to the part that is replayed, under another name, for a while."""
    task = asyncio.current_task()
    assert task is not None
    before, token = task.get_name(), _ACTING.set(_BY_TASK)
    task.set_name(name)
    try:
        yield
    finally:
        task.set_name(before)
        _ACTING.reset(token)


def taking(take: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """A function that takes something from outside, called by anybody on the loop."""

    def take_as_input(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        context = copy_context()
        context.run(_ACTING.set, INPUT)
        return context.run(take, *args, **kwargs)

    return take_as_input

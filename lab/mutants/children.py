"""Work in forked processes: each child does one thing, tells the result as JSON, and is gone."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import shutil
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

DIED: Final = "died"
"""Key of the result of a child that said nothing: the signal that ended it, or 0."""
FAILED: Final = "failed"
"""Key of the result of a child whose work raised: the traceback."""
SECONDS: Final = "seconds"
"""Key of every result: computing time of the child, and of those of its own that it waited for [s]."""


class _Child(NamedTuple):
    pid: int
    pipe: int
    folder: Path
    received: bytearray


def run_forked(
    work: Iterable[tuple[str, Callable[[], dict[str, Any]]]], jobs: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Do each piece of work in a child of its own, some at a time, and give the results as they come.

    Args:
        work: a name and what to do; taken when a child is free.
        jobs: children at a time.

    Yields:
        The name, and the result with `SECONDS`; one with `DIED` where the child was ended, with `FAILED` where the work
        raised.
    """
    waiting = iter(work)
    selector = selectors.DefaultSelector()
    running: dict[str, _Child] = {}
    try:
        while True:
            while len(running) < jobs and (piece := next(waiting, None)) is not None:
                name, do = piece
                running[name] = child = _fork(do)
                selector.register(child.pipe, selectors.EVENT_READ, name)
            if not running:
                return
            for key, _ in selector.select():
                child = running[key.data]
                chunk = os.read(child.pipe, 1 << 16)
                child.received.extend(chunk)
                if not chunk:
                    selector.unregister(child.pipe)
                    yield key.data, _end(running.pop(key.data))
    finally:
        for child in running.values():
            _end(child)
        selector.close()


def _fork(do: Callable[[], dict[str, Any]]) -> _Child:
    folder = Path(tempfile.mkdtemp(prefix="mutant-"))
    reading, writing = os.pipe()
    pid = os.fork()
    if pid:
        os.close(writing)
        return _Child(pid, reading, folder, bytearray())
    try:
        os.setsid()
        os.environ["PYTEST_DEBUG_TEMPROOT"] = str(folder)
        tempfile.tempdir = str(folder)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nothing, stream)
        try:
            result = do()
        except BaseException:  # noqa: BLE001 - whatever it was is the result
            result = {FAILED: traceback.format_exc()}
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(json.dumps(result).encode())
    finally:
        os._exit(0)


def _end(child: _Child) -> dict[str, Any]:
    """End what is left of a child and its own children."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)
    _, status, used = os.wait4(child.pid, 0)
    seconds = round(used.ru_utime + used.ru_stime, 3)
    os.close(child.pipe)
    shutil.rmtree(child.folder, ignore_errors=True)
    try:
        result = json.loads(child.received)
    except ValueError:
        result = {DIED: os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0}
    assert isinstance(result, dict)
    return {**result, SECONDS: seconds}

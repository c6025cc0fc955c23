"""Runs a command in a forked child, with limits, and says how it ended."""

from __future__ import annotations

import atexit
import importlib
import io
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NoReturn

from cyclopts import App

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkctl.commands import COMMANDS as MKCTL
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.mkdaemon.commands import COMMANDS as MKDAEMON
from mkdaemon.cli.program import run

MOST_CPU: Final = 5.0
"""Of a command that reads a file [s]."""
MOST_MEMORY: Final = 300e6
"""Of its process [bytes]."""
PATIENCE: Final = 40.0
"""A command that has not ended is killed then [s]: it waits for something, or the machine is busy."""
EXHAUSTED: Final = 10
"""A command is killed after so much processor time [s]."""
_MOST_DATA: Final = 2_000_000_000
"""More memory is refused to a child, so that one does not harm the machine [bytes]."""
_TOLD: Final = 100_000
"""Of what it printed, so much is kept [bytes]."""
RAISED: Final = 70
"""Exit code of a child in which an exception was not caught."""
APPS: Final[dict[str, App]] = {"mkctl": mkctl, "mkdaemon": mkdaemon}
_LATER: Final = (
    *("mkdaemon.record.rewrite", "mkdaemon.record.summary", "mkdaemon.client.export.tracks"),
    *("mkdaemon.gateways.ros2.bag", "mkdaemon.client.export.parquet", "mkdaemon.replay.report"),
    *("rosbags.typesys", "rosbags.rosbag2", "mkdaemon.client.player", "mkdaemon.client.playselection"),
    *("mkdaemon.record.view", "mkdaemon.client.samples", "rich.progress"),
)
"""Imported by commands when they run."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended.

    Attributes:
        code: exit code; negative for a signal.
        cpu: processor time [s].
        wall: time [s].
        memory: at its peak, with everything that was imported before [bytes].
        out: standard output.
        err: standard error.
    """

    code: int
    cpu: float
    wall: float
    memory: int
    out: str
    err: str


def prepare() -> None:
    """Import every command once, for all children."""
    for entry in (*MKCTL, *MKDAEMON):
        importlib.import_module(entry.target.partition(":")[0])
    for name in _LATER:
        with suppress(ImportError):
            importlib.import_module(name)


def run_forked(
    program: Literal["mkctl", "mkdaemon"], words: Sequence[str], folder: Path, *, end_after: float | None = None
) -> Ended:
    """Run a command in a child.

    Args:
        program: which.
        words: its command line.
        folder: where it runs.
        end_after: a command that runs until it is told to end is told so then [s].
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        sys.stdout.flush()
        sys.stderr.flush()
        began = time.monotonic()
        child = os.fork()
        if child == 0:
            _be_child(APPS[program], words, folder, out.fileno(), err.fileno())
        status, used = _wait(child, began, end_after)
        return Ended(
            os.waitstatus_to_exitcode(status),
            used.ru_utime + used.ru_stime,
            time.monotonic() - began,
            used.ru_maxrss * 1024,
            _text(out.fileno()),
            _text(err.fileno()),
        )


def _wait(child: int, began: float, end_after: float | None) -> tuple[int, resource.struct_rusage]:
    pause = 0.001
    while True:
        pid, status, used = os.wait4(child, os.WNOHANG)
        if pid:
            return status, used
        passed = time.monotonic() - began
        if passed > PATIENCE:
            os.kill(child, signal.SIGKILL)
        elif end_after is not None and passed > end_after:
            end_after = None
            os.kill(child, signal.SIGTERM)
        time.sleep(pause)
        pause = min(pause * 1.5, 0.05)


def _text(number: int) -> str:
    return os.pread(number, _TOLD, 0).decode("utf-8", "surrogateescape")


def _be_child(app: App, words: Sequence[str], folder: Path, out: int, err: int) -> NoReturn:
    """Never returns: the child ends with the command."""
    code = RAISED
    try:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(out, 1)
        os.dup2(err, 2)
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w"), encoding="utf-8", errors="strict")
        sys.stderr = io.TextIOWrapper(io.FileIO(2, "w"), encoding="utf-8", errors="backslashreplace")
        resource.setrlimit(resource.RLIMIT_CPU, (EXHAUSTED, EXHAUSTED + 1))
        resource.setrlimit(resource.RLIMIT_DATA, (_MOST_DATA, _MOST_DATA))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (_MOST_DATA, _MOST_DATA))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.chdir(folder)
        code = run(app, words)
    except BaseException:  # noqa: BLE001  # this is what is looked for
        traceback.print_exc()
    finally:
        with suppress(OSError, ValueError):
            atexit._run_exitfuncs()  # noqa: SLF001  # what waits to be logged; there is no other way
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)

"""Nothing that a test starts outlives the tests, whatever ends them: not even a daemon that a demo of a test started.

Every program of a test inherits a mark in its environment. Beside the tests runs a small process that waits for the end
of its standard input, which nobody but the tests holds open, and then ends whatever has that mark.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

MARK: Final = "STARTED_BY_TESTS"
"""Variable of the environment; its value is that of one run."""
ROUNDS: Final = 20
"""Rounds of killing: what is killed may have started something meanwhile."""


@contextmanager
def no_orphans() -> Iterator[dict[str, str]]:
    """Give the environment of what is started; all of it ends with the context, or with this process."""
    value = uuid.uuid4().hex
    command = [sys.executable, "-I", "-S", __file__, value]
    with subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True) as reaper:
        yield {MARK: value}
        assert reaper.stdin is not None
        reaper.stdin.close()


def marked(value: str) -> list[int]:
    """Processes with this mark."""
    wanted = f"{MARK}={value}".encode()
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if wanted in (entry / "environ").read_bytes().split(b"\0"):
                found.append(int(entry.name))
    return found


def _reap(value: str) -> None:
    sys.stdin.buffer.read()
    for _ in range(ROUNDS):
        if not (left := marked(value)):
            return
        for process in left:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
        time.sleep(0.05)


if __name__ == "__main__":
    _reap(sys.argv[1])

"""`mkdaemon` with a trouble that a signal brings about: `python -m lab.rigs.troubled WHICH run ...`.

`TROUBLE` makes it happen. Everything else is the daemon's own program.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from typing import Any, Final

from mkdaemon.cli.mkdaemon.app import main

TROUBLE: Final = signal.SIGUSR2
"""What the lab tells a daemon by; SIGUSR1 is the daemon's own (see `mkdaemon.cli.mkdaemon.run.RELOAD`)."""
DETECTOR: Final = 2.0
"""The thread of the eyes stands still for so long [s]."""
DISK: Final = 6.0
"""And that of the recorder [s]."""
HOLD: Final = 3.0
"""A C call keeps the interpreter for so long [s]."""


class Trouble(StrEnum):
    """What happens."""

    DETECTOR = "detector"
    """The thread that looks at images; the others go on."""
    INTERPRETER = "interpreter"
    """It stands still in a C call that keeps the interpreter from all other threads."""
    DISK = "disk"
    """The recorder's thread, in a write."""
    HELD = "held"
    """Everything, in a C call at once."""
    BLOCKED = "blocked"
    """Nobody reads standard error any more, as after Ctrl-S."""


def stand_still(which: Trouble) -> tuple[type, str, Callable[[], None]]:
    """Where it happens, class and method, and what happens there."""
    if which is Trouble.DISK:
        from mkdaemon.record.recorder import Recorder

        return Recorder, "step", lambda: time.sleep(DISK)
    from mkdaemon.vision.pipeline import CameraPipeline

    keeps_interpreter = which is Trouble.INTERPRETER
    sleep = ctypes.PyDLL(None).usleep if keeps_interpreter else None
    return CameraPipeline, "process", lambda: time.sleep(DETECTOR) if sleep is None else sleep(int(1e6 * DETECTOR))


def wait_for_signal(which: Trouble) -> None:
    """Let it happen once, in the next call after each `TROUBLE`."""
    owner, name, act = stand_still(which)
    wanted, method = threading.Event(), getattr(owner, name)

    def troubled(*args: Any, **fields: Any) -> Any:
        if wanted.is_set():
            wanted.clear()
            act()
        return method(*args, **fields)

    setattr(owner, name, troubled)
    signal.signal(TROUBLE, lambda number, frame: wanted.set())


def hold() -> None:
    """Keep the interpreter, as a C library that does not let go of it."""
    ctypes.PyDLL(None).usleep(int(1e6 * HOLD))


def block() -> None:
    """Put a pipe that is full in the place of standard error."""
    _, full = os.pipe()
    os.set_blocking(full, False)
    with suppress(BlockingIOError):
        while os.write(full, bytes(4096)):
            pass
    os.set_blocking(full, True)
    os.dup2(full, 2)


if __name__ == "__main__":
    trouble = Trouble(sys.argv.pop(1))
    if trouble in {Trouble.HELD, Trouble.BLOCKED}:
        signal.signal(TROUBLE, lambda number, frame: hold() if trouble is Trouble.HELD else block())
    else:
        wait_for_signal(trouble)
    main()

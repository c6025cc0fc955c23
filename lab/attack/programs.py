"""Daemons that a signal holds up or makes mute: what `python -c` runs in place of the daemon's own program."""

from __future__ import annotations

import signal
from typing import Final

TROUBLE: Final = signal.SIGUSR2
"""What the lab tells a daemon by; SIGUSR1 is the daemon's own (see `mkdaemon.cli.mkdaemon.run.RELOAD`)."""
HOLD: Final = 3.0
"""How long the C call takes [s]."""
_RUN: Final = """
from mkdaemon.cli.mkdaemon.app import main
main()
"""
_BLOCK: Final = """
import os
def block():
    _, full = os.pipe()
    os.set_blocking(full, False)
    try:
        while os.write(full, bytes(4096)):
            pass
    except BlockingIOError:
        os.set_blocking(full, True)
    os.dup2(full, 2)
"""
HELD_DAEMON: Final = f"""
import ctypes, signal
libc = ctypes.PyDLL(None)  # keeps the interpreter, as a C library that does not let go of it
signal.signal({int(TROUBLE)}, lambda number, frame: libc.usleep({int(HOLD * 1e6)}))
{_RUN}"""
"""A daemon that `TROUBLE` holds up in a C call."""
BLOCKED_DAEMON: Final = f"""
import signal
{_BLOCK}
signal.signal({int(TROUBLE)}, lambda number, frame: block())
{_RUN}"""
"""A daemon whose standard error nobody reads from `TROUBLE` on, as after Ctrl-S."""
DEAF_DAEMON: Final = f"""{_BLOCK}
block()
{_RUN}"""
"""A daemon whose first line on standard error waits for ever."""

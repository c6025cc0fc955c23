"""A program in which a thread of Zenoh, or one that puts at given times, must not wait for the others."""

from __future__ import annotations

import asyncio
import gc
import sys
from collections.abc import Callable
from typing import Final

SWITCH: Final = 0.0005
"""Longest time for which a computing thread keeps the interpreter from others [s]. With Python's default of 5 ms, every
value that arrives or is due meanwhile would be 5 ms late."""


def favour_threads() -> None:
    """Let threads take turns often, and take what is loaded out of the collector's sight.

    A full collection of a loaded program holds every thread for 20 to 100 ms; nothing of it becomes garbage.
    """
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()


def fast_loop() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """The loop that brings a value from Zenoh's thread in two thirds of the time, where it is installed (Linux)."""
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop

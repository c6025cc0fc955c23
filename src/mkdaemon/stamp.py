"""The stamp every value carries: one moment, on both clocks."""

from __future__ import annotations

from typing import Final

from pydantic import ConfigDict

from mkdaemon.described import Described

NANOSECONDS: Final = 1_000_000_000
"""In a second."""


def nanoseconds(time: float) -> int:
    """Whole nanoseconds of a time [s]; `seconds` returns the same time, for Unix time and 48 days of monotonic time."""
    whole = int(time)
    return whole * NANOSECONDS + round((time - whole) * NANOSECONDS)


def seconds(time: int) -> float:
    """A time [s] from nanoseconds."""
    return time / NANOSECONDS


class Stamp(Described):
    """A moment, on the monotonic and on the system clock; docs/frames.md.

    Compare and subtract `monotonic` where `boot` is equal; use `wall` between machines and across restarts, and look
    at `synchronised` before believing it.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    monotonic: float
    """On the clock that never jumps [s]; it counts from the machine's start and stops while the machine sleeps."""
    wall: float
    """Unix time [s]."""
    boot: str = ""
    """Names the monotonic clock: the first eight digits of the kernel's boot id; empty where it is not known."""
    synchronised: bool | None = None
    """Whether the kernel says that the system clock follows a time server; null where it does not say."""

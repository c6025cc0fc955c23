"""One look at both clocks."""

from __future__ import annotations

import time
from typing import NamedTuple


class Instant(NamedTuple):
    """A moment on both clocks; unpacks into every value that carries `t_monotonic` and `t_wall`.

    Attributes:
        t_monotonic: [s; monotonic].
        t_wall: [s; Unix time].
    """

    t_monotonic: float
    t_wall: float


def now() -> Instant:
    """The present moment."""
    return Instant(time.monotonic(), time.time())

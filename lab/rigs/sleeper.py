"""How late the machine wakes a thread: what is measured beside a load is the load's."""

from __future__ import annotations

import threading
import time
from typing import Final

import numpy as np

LOOK: Final = 0.002
"""The thread sleeps so long each time [s]."""


class Sleeper:
    """A thread that only sleeps while the context lasts, and how late it was woken."""

    def __init__(self) -> None:
        self._late: list[float] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sleeper", daemon=True)

    def __enter__(self) -> Sleeper:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            start = time.monotonic()
            time.sleep(LOOK)
            self._late.append(time.monotonic() - start - LOOK)

    def percentile(self, part: float) -> float:
        """How late it was woken [ms]."""
        return round(1000 * float(np.percentile(self._late, part)), 2)

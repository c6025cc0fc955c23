"""Counts losses on the way to a recorder: once a second the daemon publishes the number of values of each key.

Values of one daemon arrive in the order in which it put them: between two of its counts as many must have come as it
counted.
"""

from __future__ import annotations

from collections import Counter
from typing import Final

from mkdaemon.record.entry import unpacked

COUNTS: Final = "bus/counts"


class CountCheck:
    """Compares what came from one vehicle with what its daemon counted.

    Attributes:
        lost: values that were put and did not come, by key without `mk/<vehicle>/`.
    """

    def __init__(self) -> None:
        self.lost: Counter[str] = Counter()
        self._arrived: Counter[str] = Counter()
        self._counted: dict[str, int] | None = None

    def take(self, suffix: str, payload: bytes) -> None:
        """Take a value, in the order in which they came.

        Args:
            suffix: key without `mk/<vehicle>/`.
            payload: as it came.
        """
        if suffix != COUNTS:
            self._arrived[suffix] += 1
            return
        counted, before, arrived = _counts_in(payload), self._counted, self._arrived
        self._counted, self._arrived = counted, Counter()
        if before is None or any(counted.get(key, 0) < number for key, number in before.items()):
            return  # the first one, or the daemon was restarted
        for key, number in counted.items():
            missing = number - before.get(key, 0) - arrived[key]
            if key != COUNTS and missing > 0:
                self.lost[key] += missing


def _counts_in(payload: bytes) -> dict[str, int]:
    """What a `BusCounts` says; nothing where it is none."""
    counts = unpacked(payload).get("counts")
    found = counts.items() if isinstance(counts, dict) else ()
    return {str(key): number for key, number in found if isinstance(number, int)}

"""Which camera the estimate goes by where several see one target: all that agree, and by majority where they do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

TOGETHER: Final = 0.5
"""A camera whose newest image is older has no say [s]: three images of a slow one."""

AT_ONCE: Final = 0.15
"""Cameras whose newest images are no further apart share the attitude that is in their poses [s]."""


@dataclass(slots=True)
class _Record:
    """Of one camera.

    Attributes:
        at: when its newest image was taken [s].
        refused: its images refused one after the other.
    """

    at: float
    refused: int = 0


class Cameras:
    """What became of each camera's images.

    Args:
        patience: images of one camera refused one after the other before they may mean something.
    """

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._records: dict[str, _Record] = {}

    def seen(self, camera: str, at: float) -> int:
        """Note an image of a camera taken at a moment [s]; returns how many cameras see the target then."""
        record = self._records.setdefault(camera, _Record(at))
        record.at = max(record.at, at)
        return sum(abs(at - each.at) <= AT_ONCE for each in self._records.values())

    def judged(self, camera: str, *, is_refused: bool) -> None:
        """Note what became of an image of a camera that was seen."""
        record = self._records[camera]
        record.refused = record.refused + 1 if is_refused else 0

    def expect_change(self) -> None:
        """Let the next image of any camera count as one after too many refused ones."""
        for record in self._records.values():
            record.refused = self._patience

    def doubts(self, camera: str, at: float) -> bool:
        """Whether the estimate is wrong and not a camera that was refused: most cameras contradict it."""
        if self._records[camera].refused < self._patience:
            return False
        recent = [each for each in self._records.values() if at - each.at <= TOGETHER]
        refused = sum(each.refused >= self._patience for each in recent)
        return 2 * refused > len(recent)

    @property
    def contradicting(self) -> tuple[str, ...]:
        """Cameras whose images contradict what others show."""
        newest = max((each.at for each in self._records.values()), default=0.0)
        recent = {name: each for name, each in self._records.items() if newest - each.at <= TOGETHER}
        refused = tuple(sorted(name for name, each in recent.items() if each.refused >= self._patience))
        return refused if len(refused) < len(recent) else ()

"""Which of several cameras, and sources of poses, the estimate uses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

TOGETHER: Final = 0.5
"""A camera whose newest image is older has no vote [s]: three images of a slow camera."""
AGREED: Final = 30
"""A source of poses that was wrong is used again after as many poses one after the other that agree: one second. One
agrees soon by chance, because a mirrored place differs little near the middle."""
AT_ONCE: Final = 0.15
"""Cameras whose newest images are no further apart share the attitude that is in their poses [s]."""


@dataclass(slots=True)
class _Record:
    """How the images of one camera were judged.

    Attributes:
        at: when its newest image was taken [s].
        is_placed: it is a source of poses from outside.
        refused: its images refused one after the other.
        agreed: those that were not, one after the other.
        is_wrong: it contradicted the camera in use, and the two do not agree yet.
        is_new: a source that came after a camera, and has not agreed for long yet.
    """

    at: float
    is_placed: bool = False
    refused: int = 0
    agreed: int = 0
    is_wrong: bool = False
    is_new: bool = False


class Cameras:
    """Selects the cameras that the estimate uses if several see one target: all that agree, else the majority.

    Sources of poses from outside count as cameras, but outvote none: a source can be mirrored or late, or follow
    another body, and the images of a camera cannot.

    Args:
        patience: consecutive refused images of one camera before the camera or the estimate is doubted.
    """

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._records: dict[str, _Record] = {}

    def seen(self, camera: str, at: float, *, is_placed: bool = False) -> int:
        """Note an image of a camera, taken at a time [s]; return how many cameras see the target at that time."""
        record = self._records.get(camera)
        if record is None:
            is_new = is_placed and self._is_seen_by_camera(at)
            record = self._records.setdefault(camera, _Record(at, is_placed, is_new=is_new))
        record.at = max(record.at, at)
        return sum(each is record or abs(at - each.at) <= AT_ONCE for each in self._records.values())

    @property
    def are_refused(self) -> bool:
        """Whether every camera that shows the target has had too many images refused one after the other."""
        return all(each.refused >= self._patience for each in self._records.values())

    def judged(self, camera: str, *, is_refused: bool) -> tuple[str, ...]:
        """Note whether an image of a camera was refused; return the cameras that this image shows to be wrong."""
        trusted = [name for name, each in self._records.items() if not each.is_wrong]
        self._weigh(self._records[camera], is_refused=is_refused)
        return tuple(name for name in trusted if self._records[name].is_wrong)

    def _weigh(self, record: _Record, *, is_refused: bool) -> None:
        record.refused, record.agreed = (record.refused + 1, 0) if is_refused else (0, record.agreed + 1)
        record.is_new &= record.agreed < AGREED
        others = [each for each in self._records.values() if each is not record and record.at - each.at <= TOGETHER]
        peers = [each for each in others if record.is_placed or not each.is_placed]
        if any(each.refused < self._patience for each in peers):
            stays = record.agreed < AGREED if record.is_placed else is_refused
            record.is_wrong = record.refused >= self._patience or (record.is_wrong and stays)
        elif record.refused >= self._patience:
            for each in others:
                if each.is_placed and not record.is_placed:
                    each.is_wrong, each.agreed = True, 0

    def is_alone(self, camera: str) -> bool:
        """Whether no other camera has shown the target lately."""
        newest = max((each.at for each in self._records.values()), default=0.0)
        return all(name == camera or newest - each.at > TOGETHER for name, each in self._records.items())

    def _is_seen_by_camera(self, at: float) -> bool:
        return any(not each.is_placed and at - each.at <= TOGETHER for each in self._records.values())

    def is_on_trial(self, camera: str) -> bool:
        """Whether a source is only compared with a camera: it came after that, and has not agreed for long yet."""
        record = self._records[camera]
        return record.is_new and self._is_seen_by_camera(record.at)

    def uses(self, camera: str) -> bool:
        """Whether a camera has shown the target lately, and is not left out."""
        newest = max((each.at for each in self._records.values()), default=0.0)
        record = self._records.get(camera)
        return record is not None and newest - record.at <= TOGETHER and not (record.is_wrong or record.is_new)

    def expect_change(self) -> None:
        """Treat the next image of every camera as if too many had been refused before it."""
        for record in self._records.values():
            record.refused = self._patience

    def doubts(self, camera: str, at: float) -> bool:
        """Whether the estimate is wrong and not a camera that was refused: most cameras contradict it.

        A camera stays wrong after the camera that contradicted it falls silent.
        """
        record = self._records[camera]
        if record.refused < self._patience or (record.is_wrong and self._are_wrong_outvoted):
            return False
        recent = [each for each in self._records.values() if at - each.at <= TOGETHER]
        recent = [each for each in recent if record.is_placed or not each.is_placed]
        refused = sum(each.refused >= self._patience for each in recent)
        return 2 * refused > len(recent)

    @property
    def contradicting(self) -> tuple[str, ...]:
        """Cameras whose images contradict what others show."""
        if len(self._records) < 2:
            return ()
        newest = max((each.at for each in self._records.values()), default=0.0)
        recent = {name: each for name, each in self._records.items() if newest - each.at <= TOGETHER}
        refused = sorted(name for name, each in recent.items() if each.is_wrong or each.refused >= self._patience)
        if len(refused) == len(recent):
            refused = [name for name in refused if recent[name].is_wrong and self._are_wrong_outvoted]
        return tuple(refused)

    @property
    def _are_wrong_outvoted(self) -> bool:
        """Whether no more than half of all cameras were found wrong."""
        return 2 * sum(each.is_wrong for each in self._records.values()) <= len(self._records)

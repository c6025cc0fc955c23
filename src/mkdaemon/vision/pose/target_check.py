"""Whether the tags of a target contradict each other: a wrong size or position in the target file shows itself here.

The outline of the largest tag in view says where every other tag of the same plane must be. Sizes that are all wrong by
the same factor fit together: only a ruler tells.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cellread import Detection, carry
from mkdaemon.vision.tags.tagmap import Tag, TagMap


class TargetCheck:
    """Watches whether what is seen of each target agrees with the target file; without a lens nothing is judged."""

    def __init__(self, tagmap: TagMap, projection: Projection | None) -> None:
        self._tagmap, self._projection = tagmap, projection
        self._contradictions = dict.fromkeys((target.name for target in tagmap.targets), 0)

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Targets whose file is wrong."""
        return tuple(name for name, count in self._contradictions.items() if count >= LIMITS.health.misfit_images)

    def look(self, detections: Iterable[Detection]) -> None:
        """Judge the tags decoded in one image; only tags that agree take a contradiction back."""
        if self._projection is None:
            return
        owners = self._tagmap.owners
        seen = [(*owners[found.code], found) for found in detections if found.code in owners]
        for target in (target for target in self._tagmap.targets if target.is_planar):
            is_wrong = misfit([(tag, found) for owner, tag, found in seen if owner is target], self._projection)
            if is_wrong is not None:
                self._contradictions[target.name] = self._contradictions[target.name] + 1 if is_wrong else 0


def misfit(seen: list[tuple[Tag, Detection]], projection: Projection) -> bool | None:
    """Whether one of several tags of a plane is not where the largest one says; none without one to compare."""
    if not seen:
        return None
    base, at = max(seen, key=lambda pair: pair[1].side_px)
    reach = LIMITS.health.misfit_reach * base.size
    near = [pair for pair in seen if pair[0] is not base and np.linalg.norm(pair[0].position - base.position) < reach]
    outline, found_at = base.local(base.corners)[:, :2], projection.undistort(at.corners)
    ahead = np.asarray(cv2.getPerspectiveTransform(outline.astype(np.float32), found_at.astype(np.float32)), np.float64)
    are_off: list[bool] = []
    for tag, found in near:
        expected = carry(ahead, base.local(tag.corners)[:, :2])
        off = float(np.linalg.norm(expected - projection.undistort(found.corners), axis=1).max())
        loose = LIMITS.health.misfit_px * max(at.shrunk, found.shrunk)
        are_off.append(off * float(projection.focal.mean()) > max(loose, LIMITS.health.misfit_share * found.side_px))
    return any(are_off) if near else None

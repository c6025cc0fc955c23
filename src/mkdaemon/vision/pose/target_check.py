"""Do the tags of one target contradict each other? A wrong size or position in the target file shows itself here.

The outline of the largest tag in view says where every other tag of the same plane must be. Sizes that are all wrong by
the same factor fit together and cannot be seen this way: only a ruler tells.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.tagmap import Tag, TagMap


class TargetCheck:
    """Watches whether what is seen of each target agrees with the target file.

    Args:
        tagmap: the targets.
        projection: the lens; without one nothing is judged.
    """

    def __init__(self, tagmap: TagMap, projection: Projection | None) -> None:
        self._tagmap = tagmap
        self._projection = projection
        self._contradictions = dict.fromkeys((target.name for target in tagmap.targets), 0)

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Targets whose file is wrong."""
        return tuple(name for name, count in self._contradictions.items() if count >= LIMITS.health.misfit_images)

    def look(self, detections: Iterable[Detection]) -> None:
        """Judge the tags decoded in one image; only tags that agree take a contradiction back."""
        if self._projection is None:
            return
        found: dict[str, list[tuple[Tag, Detection]]] = {}
        for detection in detections:
            owner = self._tagmap.owners.get((detection.family, detection.tag_id))
            if owner is not None and owner[0].is_planar:
                found.setdefault(owner[0].name, []).append((owner[1], detection))
        for name, seen in found.items():
            worst = misfit(seen, self._projection)
            if worst is not None:
                self._contradictions[name] = self._contradictions[name] + 1 if worst else 0


def misfit(seen: list[tuple[Tag, Detection]], projection: Projection) -> bool | None:
    """Whether a tag is not where the largest one says; None when there is nothing to compare.

    Args:
        seen: tags of one plane with what was found of them.
        projection: the lens.
    """
    seen = sorted(seen, key=lambda pair: -pair[1].side_px)
    (base, at), others = seen[0], seen[1:]
    near = [
        (tag, found)
        for tag, found in others
        if tag is not base
        and float(np.linalg.norm(tag.position - base.position)) < LIMITS.health.misfit_reach * base.size
    ]
    if not near:
        return None
    plane = base.rotation[:, :2]

    def flat(tag: Tag) -> Array:
        return np.asarray((tag.corners - base.position) @ plane, dtype=np.float64)

    ahead, _ = cv2.findHomography(flat(base), projection.undistort(at.corners))
    if np.size(ahead) <= 1:
        return None  # corners on one line
    focal = 0.5 * (projection.intrinsics.fx + projection.intrinsics.fy)
    wrong = False
    for tag, found in near:
        expected = cv2.perspectiveTransform(flat(tag)[:, None, :], ahead)[:, 0]
        off = focal * float(np.linalg.norm(expected - projection.undistort(found.corners), axis=1).max())
        loose = LIMITS.health.misfit_px * max(at.shrunk, found.shrunk)
        wrong |= off > max(loose, LIMITS.health.misfit_share * found.side_px)
    return wrong

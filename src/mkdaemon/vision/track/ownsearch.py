"""Decoding the tags of one target in a part of an image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import Limits, Stage
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import Tag, Target

Grey = npt.NDArray[np.uint8]
Window = tuple[int, int, int, int]
"""`(x0, y0, x1, y1)` [px], end exclusive."""
REDECODED: Final[tuple[Stage, ...]] = ("decimate1", "linear", "log")
"""How a followed target is decoded again."""


class OwnSearch:
    """Searches windows for the tags of one target.

    Args:
        target: whose tags.
        detector: that decodes.
        limits: all thresholds.
    """

    def __init__(self, target: Target, detector: Detector, limits: Limits) -> None:
        self._target, self._detector, self._limits = target, detector, limits

    def again(self, pixels: Grey, window: Window) -> list[Detection]:
        """Tags of a part of the image, searched as it is and in light."""
        for stage in REDECODED:
            found = self._detector.search_shrunk(pixels, stage, window)
            if self.own(found):
                return found
        return []

    def nearby(self, pixels: Grey, window: Window, misses: int) -> list[Detection]:
        """Tags of a part of the image, searched in another way after every miss."""
        ways: tuple[tuple[Stage, ...], ...] = self._limits.search.nearby
        found: list[Detection] = []
        for stage in ways[misses % len(ways)]:
            found = found or self._detector.search_shrunk(pixels, stage, window)
        return found

    def own(self, found: Sequence[Detection]) -> list[tuple[Tag, Detection]]:
        """The target's own tags among decoded ones."""
        own = {(tag.family.name, tag.tag_id): tag for tag in self._target.tags}
        pairs = ((own.get((detection.family, detection.tag_id)), detection) for detection in found)
        return [(tag, detection) for tag, detection in pairs if tag is not None]

"""Following a map of tags: one print of it at a time, the one that shows best near the middle of the image.

A print, with the tags that lie on it, is measured as any target, in the axes of the map. When another one shows better
the track goes on with that one: whatever is known is carried to its origin, exactly, since both lie in one rigid map.
So an image of a map takes the time of an image of one target, however many tags the map has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.pose.pose import Pose, moved
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import Tag, Target, covered
from mkdaemon.vision.track.attitude import Mounting
from mkdaemon.vision.track.follower import Follower, FoundBy, Measurer, TargetPose, TrackedFrame

KEPT: Final = 32
"""Prints whose models are kept."""
MIDDLE: Final = 0.25
"""A print in the middle of the image counts as if it were this share of the width away: a large one beside it wins."""
BETTER: Final = 0.7
"""Share of the present print's distance from which another one takes its place: between two it does not alternate."""
LEAST_FACING: Final = 0.2
"""Cosine between a print's normal and the way to the camera; flatter ones are not chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class _Print:
    """A print of the map: its tags, largest first, about the middle of the first one."""

    tags: tuple[Tag, ...]
    origin: Array


class MapFollower(Follower):
    """Finds and follows a map; see the module."""

    def __init__(
        self,
        target: Target,
        projection: Projection,
        detector: Detector,
        mounting: Mounting | None,
        cfg: TrackerSection,
    ) -> None:
        self._map, self._prints, self._now = target, prints_of(target), 0
        self._origins = np.array([each.origin for each in self._prints])
        self._normals = np.array([each.tags[0].rotation[:, 2] for each in self._prints])
        self._sizes = np.array([each.tags[0].size for each in self._prints])
        self._print_of = {tag.code: k for k, each in enumerate(self._prints) for tag in each.tags}
        self._measurers = lru_cache(maxsize=KEPT)(self._measurer)
        super().__init__(self._alone(0), projection, detector, mounting, cfg)

    def follow(self, frame: TrackedFrame) -> None:
        """Go on with the print that shows best by the prediction, and find it where it should be."""
        sight = self.level.sight(frame.sight)
        if self.track.goes_on(sight.time):
            self._go_on_with(self._best(self.track.predict(sight)))
        super().follow(frame)

    def start(self, frame: TrackedFrame, found: Sequence[Detection], mode: FoundBy) -> None:
        """Start or restart the track from the print of decoded tags that shows best."""
        own = [one for one in found if one.code in self._print_of]
        if own:
            best = min(own, key=lambda one: self._badness(one.corners.mean(axis=0), one.side_px))
            self._go_on_with(self._print_of[best.code])
        super().start(frame, found, mode)

    def side_px(self, pose: Pose) -> float:
        """Side of the print that is followed in an image, by a pose of the map [px]."""
        return self._fitter.side_px(moved(pose, self._origins[self._now]))

    def _published(self, found: TargetPose) -> TargetPose:
        """A pose of the print as one of the map."""
        first, origin = self._prints[self._now].tags[0], self._origins[self._now]
        # A print that lies elsewhere, or turned, shows the map so: in camera axes, R S R^T of each.
        survey = np.zeros((6, 6))
        for at, sd in ((slice(3), first.place_sd), (slice(3, 6), first.turn_sd)):
            survey[at, at] = (found.pose.rotation * sd**2) @ found.pose.rotation.T
        pose = replace(found.pose, covariance=found.pose.covariance + survey)
        return replace(found, pose=moved(pose, -origin), measured_at=origin, is_of_map=True)

    def _go_on_with(self, index: int) -> None:
        """Measure this print from now on."""
        if index == self._now:
            return
        by = self._origins[index] - self._origins[self._now]
        self._now = index
        self._measure_by(self._measurers(index))
        self.track.carry(by)
        if self.contradicting is not None:
            self.contradicting = moved(self.contradicting, by)

    def _measurer(self, index: int) -> Measurer:
        return self._measurer_of(self._alone(index))

    def _alone(self, index: int) -> Target:
        """One print as a target: axes of the map, origin in its own middle."""
        chosen = self._prints[index]
        tags = tuple(replace(tag, position=tag.position - chosen.origin) for tag in chosen.tags)
        return replace(self._map, tags=tags, places=())

    def _best(self, pose: Pose) -> int:
        """The print that shows best by a pose of the present one."""
        lens = self._fitter.projection
        centres = (self._origins - self._origins[self._now]) @ pose.rotation.T + pose.position
        facing = -np.einsum("ni,ni->n", self._normals @ pose.rotation.T, centres)
        facing /= np.maximum(np.linalg.norm(centres, axis=1), 1e-9)
        pixels, visible = lens.project(centres)
        size = np.array([lens.intrinsics.width, lens.intrinsics.height])
        visible &= (facing > LEAST_FACING) & ((pixels >= 0.0) & (pixels < size)).all(axis=1)
        if not visible.any():
            return self._now
        badness = np.full(len(visible), np.inf)
        sides = float(lens.focal[0]) * self._sizes[visible] / centres[visible, 2]
        badness[visible] = self._badness(pixels[visible], sides)
        badness[self._now] *= BETTER
        return int(np.argmin(badness))

    def _badness(self, pixels: Array, side_px: Array | float) -> Array:
        """Distance from the middle of the image over the side, of prints at pixels `(..., 2)`."""
        lens = self._fitter.projection.intrinsics
        off = np.linalg.norm(pixels - (lens.width / 2, lens.height / 2), axis=-1)
        return np.asarray((off + MIDDLE * lens.width) / np.maximum(side_px, 1.0))


def prints_of(target: Target) -> tuple[_Print, ...]:
    """The prints of a target: each tag that lies on no larger one's paper, with all that lie on its own."""
    left, found = list(target.tags), list[_Print]()
    places = np.array([tag.position for tag in left])
    while left:
        inside = covered(places, left[0])
        inside[0] = True
        found.append(_Print(tuple(tag for tag, here in zip(left, inside, strict=True) if here), left[0].position))
        left, places = [tag for tag, here in zip(left, inside, strict=True) if not here], places[~inside]
    return tuple(found)

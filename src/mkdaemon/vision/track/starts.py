"""Where the fit of a followed target begins: the prediction, or the last pose carried over by what moved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, tee

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import Limits
from mkdaemon.vision.pose.carry import Carrier
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.track.attitude import Mounting
from mkdaemon.vision.track.level import Sight
from mkdaemon.vision.track.result import FoundBy
from mkdaemon.vision.track.track import Prediction, Track

Grey = npt.NDArray[np.uint8]
Way = tuple[FoundBy, Pose]
Start = tuple[FoundBy, Pose, Iterator[Pose]]
"""How it was found, where a fit begins, and the starts that are left to it where few edges agree."""


class Starts:
    """Orders the starts of one target.

    Args:
        fitter: that will begin there.
        carrier: of its last pose.
        track: its memory.
        mounting: of the camera.
        limits: all thresholds.
    """

    def __init__(
        self, fitter: TargetFitter, carrier: Carrier, track: Track, mounting: Mounting | None, limits: Limits
    ) -> None:
        self._fitter, self._carrier = fitter, carrier
        self._track, self._mounting, self._limits = track, mounting, limits

    def of(self, pixels: Grey, predicted: Prediction) -> Iterator[Start]:
        """Where to begin in an image `(h, w)`, the likeliest first, with the starts that are left to the first one.

        Later ones are computed only when they are asked for.
        """
        ways = self._ways(pixels, predicted)
        first = next(ways, None)
        if first is None:
            return
        left, rest = tee(ways)
        yield *first, (start for _, start in left)
        for way in rest:
            yield *way, iter(())

    def _ways(self, pixels: Grey, predicted: Prediction) -> Iterator[Way]:
        """The prediction, and the last pose carried over: before it where the image does not show what it expects."""
        track, through = self._track, self._limits.judge.flow_through
        carried: Iterator[Way] = iter(())
        if track.misses < through and track.image is not None:
            starts = self._carrier.starts(track.image, pixels, track.last, predicted.pose)
            carried = (("flow", start) for start in starts)
        if track.misses < through and (predicted.has_attitude or track.has_velocity):
            expected: list[Way] = [("predicted", predicted.pose)]
            is_seen = self._fitter.shows(pixels, predicted.pose)
            yield from chain(expected, carried) if is_seen else chain(carried, expected)
        else:
            yield from carried

    def with_climb(self, seen: Sight, start: Pose) -> Pose:
        """The start of a track's second image with the speed that both ranges tell.

        Under a rolling shutter a climb looks like a tilt, and does not change the range half way through the image. A
        fit that few edges agree with may have taken them for their neighbours, and its range says nothing.
        """
        if not self._fitter.rolls or self._track.has_velocity:
            return start
        found = self._fitter.refine(seen.pixels, start)
        if found is None or found.inliers < self._limits.agreement.blind:
            return start
        known = self._track.motion_with(seen.time, found, seen.enu_from_flu, self._mounting, seen.turning_flu)
        return start if known is None else replace(start, known_motion=known)

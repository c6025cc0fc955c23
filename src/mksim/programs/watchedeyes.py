"""What the camera of a flight in virtual time tells those who look at it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from mkdaemon.clock import Clock
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.vision import EyeState, VisionStats
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.camera.imagecodec import frame_of
from mkdaemon.vision.pipeline import setup_of
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import Mounting

PERIODS: Final = {"setup": 10.0, "stats": 1.0, "image": 0.2}
"""Between two values of a kind [s]."""
QUALITY: Final = 80
"""Of the images, as JPEG counts it."""


class WatchedEyes:
    """What a camera tells beside tags and poses, for those who look."""

    def __init__(self, name: str, intrinsics: Intrinsics, mounting: Mounting, tags: TagMap) -> None:
        """Tell nothing yet.

        Args:
            name: of the camera.
            intrinsics: of its lens.
            mounting: on the aircraft.
            tags: what it looks for.
        """
        self._name, self._intrinsics, self._mounting, self._tags = name, intrinsics, mounting, tags
        self._due = dict.fromkeys(PERIODS, float("-inf"))
        self._since: list[tuple[float, float, bool]] = []
        self._seen = 0

    def values_due(self, image: CameraImage, is_posed: bool, clock: Clock) -> Iterator[tuple[str, Telemetry]]:
        """Keys and values that are due after an image was looked at.

        Args:
            image: that was looked at.
            is_posed: it gave a pose.
            clock: virtual time.
        """
        self._seen += 1
        now, root = clock.now(), f"vision/{self._name}"
        self._since.append((now, now - image.captured_at, is_posed))
        if self._is_due("setup", now):
            yield f"{root}/setup", setup_of(self._name, self._intrinsics, self._mounting, self._tags, clock.stamp(now))
        if self._is_due("stats", now):
            yield f"{root}/stats", self._stats(clock.stamp(now))
        if self._is_due("image", now):
            yield f"{root}/image", frame_of(image, clock.stamp(image.captured_at), QUALITY, self._intrinsics.width)

    def _is_due(self, kind: str, now: float) -> bool:
        is_due = now >= self._due[kind]
        if is_due:
            self._due[kind] = now + PERIODS[kind]
        return is_due

    def _stats(self, stamp: Stamp) -> VisionStats:
        """Figures of the images since the last ones."""
        times, latencies, posed = zip(*self._since, strict=True)
        p50, p99 = (1e3 * float(np.percentile(latencies, share)) for share in (50, 99))
        fps = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0
        self._since = self._since[-1:]
        unused = ("dropped", "lost", "damaged", "reopened", "faults", "restarts")
        return VisionStats(
            stamp=stamp,
            camera=self._name,
            state=EyeState.OK,
            reason="",
            alarms={},
            source="simulated",
            width=self._intrinsics.width,
            height=self._intrinsics.height,
            fps=fps,
            processed=self._seen,
            **dict.fromkeys(unused, 0),
            posed=float(np.mean(posed)),
            refused={},
            detect_p50_ms=0.0,
            detect_p99_ms=0.0,
            latency_p50_ms=p50,
            latency_p99_ms=p99,
            settings_refused=(),
        )

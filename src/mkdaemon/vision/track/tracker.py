"""All targets of one camera: each is followed, what is missing is searched; refusals have a reason."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import Alarm, PoseRefusal
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage, in_light
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgefind import HALF_WIDTH
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import Shutter
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import FIRST, Detector, looks_of
from mkdaemon.vision.tags.outline import has_highlights
from mkdaemon.vision.tags.tagmap import TagMap, covered_cells
from mkdaemon.vision.track.attitude import AttitudeHistory, ImageSight, Mounting, Turning
from mkdaemon.vision.track.follower import Follower, TargetPose, TrackedFrame
from mkdaemon.vision.track.mapfollower import MapFollower

UNUSABLE: Final = frozenset({Alarm.WRONG_SIZE, Alarm.WRONG_KIND, Alarm.FROZEN})
"""Alarms of images that nothing is looked for in."""
DRIFT_FITS, BLUR_FITS = 30, 5
"""Residuals and widths of edges whose median counts."""
BRIGHTEST = 0.99
"""Quantile of the grey values of an image that tells whether it has light."""


@dataclass(frozen=True, slots=True)
class TargetRefusal:
    """A target of an image whose pose was measured and not believed.

    Attributes:
        target: its name.
        reason: the first check that failed.
        decode_age: time since one of its tags was last decoded [s]; None where no tag of its track was decoded.
    """

    target: str
    reason: PoseRefusal
    decode_age: float | None


@dataclass(frozen=True, slots=True, eq=False)
class VisionResult:
    """Everything one image gave.

    Attributes:
        camera: name of the camera.
        sequence: of the image.
        captured_at: middle of its exposure, monotonic [s].
        detections: decoded tags with their pixels; empty in images that were tracked without a search.
        poses: at most one per target.
        alarms: what is wrong with the image.
        refused: targets whose pose was measured and not believed.
        has_attitude: an attitude of the vehicle was near enough to the image and not left out.
    """

    camera: str
    sequence: int
    captured_at: float
    detections: tuple[Detection, ...]
    poses: tuple[TargetPose, ...]
    alarms: tuple[Alarm, ...]
    refused: tuple[TargetRefusal, ...] = ()
    has_attitude: bool = False

    def pose_of(self, target: str) -> TargetPose | None:
        """The pose of a target by name."""
        return next((pose for pose in self.poses if pose.target == target), None)


class ImageHealth:
    """Watches the images of one camera; their size is right without intrinsics."""

    def __init__(self, intrinsics: Intrinsics | None) -> None:
        self._shape = None if intrinsics is None else (intrinsics.height, intrinsics.width)
        self._last: Grey | None = None
        self._repeats = 0
        self._residuals: deque[float] = deque(maxlen=DRIFT_FITS)
        self._blur: deque[float] = deque(maxlen=BLUR_FITS)

    def check(self, pixels: npt.NDArray[Any]) -> list[Alarm]:
        """Alarms of one image, which ought to be `(h, w)` uint8; of another kind or size, that alone."""
        if pixels.dtype != np.uint8:
            return [Alarm.WRONG_KIND]
        if pixels.ndim != 2 or pixels.size == 0 or (self._shape is not None and pixels.shape != self._shape):
            return [Alarm.WRONG_SIZE]
        limits, thin = LIMITS.health, pixels[::8, ::8]
        signs = {
            Alarm.DARK: np.count_nonzero(thin < limits.dark_grey) > BRIGHTEST * thin.size,
            Alarm.BLOWN: np.count_nonzero(thin >= LIMITS.read.saturated) > HALF * thin.size,
            Alarm.FROZEN: self._is_frozen(np.ascontiguousarray(pixels[::3, ::5])),
            Alarm.BLURRED: len(self._blur) == BLUR_FITS and median(self._blur) > LIMITS.blur.alarm_px,
            Alarm.RESIDUAL_DRIFT: len(self._residuals) == DRIFT_FITS and median(self._residuals) > limits.drift_px,
        }
        return [alarm for alarm, is_seen in signs.items() if is_seen]

    def note(self, pose: Pose, side_px: float) -> None:
        """Remember the sharpness and, of edges, the residual of an accepted fit; small tags tell nothing."""
        if side_px < LIMITS.health.large_tag_px:
            return
        is_of_edges = pose.source == "edges"
        if pose.blur_px is not None:
            self._blur.append(pose.blur_px if is_of_edges else pose.blur_px * HALF_WIDTH)
        if is_of_edges and (pose.blur_px is None or pose.blur_px < LIMITS.blur.smeared_px):
            self._residuals.append(pose.rms_px)

    def _is_frozen(self, thin: Grey) -> bool:
        # A black or saturated image repeats without being frozen; those have their own alarms.
        same = self._last is not None and bool(np.array_equal(self._last, thin)) and int(thin.min()) < int(thin.max())
        self._repeats = self._repeats + 1 if same else 0
        self._last = thin
        return self._repeats >= LIMITS.health.frozen_images


class Tracker:
    """Finds and follows the targets of one camera.

    Without intrinsics it reports tags and never a pose.

    Attributes:
        detector: searches the images.
        followers: one for each target; empty without intrinsics.
        shutter: what is known of the line time; none without intrinsics.
    """

    def __init__(
        self,
        tagmap: TagMap,
        intrinsics: Intrinsics | None,
        mounting: Mounting | None = None,
        cfg: TrackerSection | None = None,
    ) -> None:
        self._cfg = cfg or TrackerSection()
        self._mounting = mounting
        self._gamma = intrinsics.gamma if intrinsics is not None else 1.0
        self.detector = Detector(tagmap.whitelist, covered=covered_cells(tagmap))
        self._health = ImageHealth(intrinsics)
        self.followers: tuple[Follower, ...] = ()
        self.shutter: Shutter | None = None
        if intrinsics is not None:
            self.shutter = Shutter(intrinsics.line_time, intrinsics.height / 2 * intrinsics.fx)
            projection = Projection(intrinsics, self.shutter)
            self.followers = tuple(
                (MapFollower if target.is_map else Follower)(target, projection, self.detector, mounting, self._cfg)
                for target in tagmap.targets
            )
        self._count = self._searches = 0

    def update(self, image: CameraImage, attitude: AttitudeHistory | None = None) -> VisionResult:
        """Process the newest image of the camera, with recent attitudes of the vehicle; no image makes it raise."""
        alarms = self._health.check(image.pixels)
        if not UNUSABLE.isdisjoint(alarms):
            self.reset()
            return VisionResult(image.camera, image.sequence, image.captured_at, (), (), tuple(alarms))
        if self.shutter is not None and self.shutter.is_open:
            alarms.append(Alarm.LINE_TIME)
        frame = TrackedFrame(self._sight(image, attitude))
        self._count += 1
        if self.followers:
            for follower in self.followers:
                follower.follow(frame)
            self._search_missing(frame)
            for follower in self.followers:
                follower.settle(frame)
            sides = {one.name: one.side_px for one in self.followers}
            for found in frame.poses:
                self._health.note(found.pose, sides[found.target](found.pose))
        else:
            alarms.append(Alarm.UNCALIBRATED)
            frame.detections.extend(self._search(frame))
        return VisionResult(
            *(image.camera, image.sequence, image.captured_at),
            *(tuple(frame.detections), tuple(frame.poses), tuple(alarms)),
            refused=self._refused(frame),
            has_attitude=frame.sight.enu_from_cam is not None and self.contradicted_deg is None,
        )

    def _refused(self, frame: TrackedFrame) -> tuple[TargetRefusal, ...]:
        """The targets of an image whose pose was refused."""
        ages = {one.name: one.decode_age(frame) for one in self.followers}
        return tuple(TargetRefusal(name, reason, ages[name]) for name, reason in frame.refused.items())

    @property
    def contradicted_deg(self) -> float | None:
        """By how much the images of level targets contradict the vehicle's attitude [deg]; none while they do not."""
        off = [one.level.contradicted_deg for one in self.followers]
        return max((deg for deg in off if deg is not None), default=None)

    def reset(self) -> None:
        """Forget all tracks, how their targets lie, and whose turn it is."""
        self._count = self._searches = 0
        for follower in self.followers:
            follower.forget()

    def _sight(self, image: CameraImage, attitude: AttitudeHistory | None) -> ImageSight:
        """An image in light, with the attitude that was reported for it."""
        time, pixels = image.captured_at, in_light(image.pixels, self._gamma)
        if attitude is None or self._mounting is None:
            return ImageSight(pixels, time)
        camera = self._mounting.flu_from_cam
        enu_from_flu, turning = attitude.at(time, self._cfg.max_attitude_age), attitude.turning_at(time)
        enu_from_cam = enu_from_flu @ camera if enu_from_flu is not None else None
        turning = Turning(camera.T @ turning.rate, turning.sd) if turning is not None else None
        return ImageSight(pixels, time, enu_from_cam, turning)

    def _search_missing(self, frame: TrackedFrame) -> None:
        """Look for what is still missing in the whole image."""
        missing = [one for one in self.followers if one.name not in frame.found | frame.started]
        if not missing or (frame.poses and self._count % LIMITS.search.beside_every):
            return
        # Right after a miss the prediction is still good; the whole image comes when the neighbourhood gave nothing.
        if all(follower.track.is_live and follower.track.misses < 1 for follower in missing):
            return
        found = self._search(frame)
        frame.detections.extend(found)
        for follower in missing:
            follower.start(frame, found, "search")

    def _search(self, frame: TrackedFrame) -> list[Detection]:
        """One of the first searches of the whole image; in every second image that shows nothing another one too."""
        pixels = frame.sight.pixels
        found = self.detector.search(pixels, *FIRST[self._searches % len(FIRST)])
        turn, not_now = divmod(self._searches, LIMITS.search.thorough_every)
        self._searches += 1
        if found or not_now:
            return found
        looks = looks_of(*pixels.shape[::-1], outline_first=has_highlights(pixels))
        return self.detector.search(pixels, *looks[turn % len(looks)])

"""One camera's images through its tracker, with the figures that tell how well it goes."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.vision import (
    Alarm,
    AttitudeLoss,
    CameraSetup,
    Exposure,
    EyeState,
    LensShape,
    PoseRefusal,
    PoseRefused,
    Tags,
    TagShape,
    TagSighting,
    TargetShape,
    Transform,
    VisionPose,
    VisionStats,
)
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.camera.calibration_file import Camera, Intrinsics, load_camera, mount_rotation
from mkdaemon.vision.camera.camera import StreamStatus
from mkdaemon.vision.camera.exposure import ExposureControl
from mkdaemon.vision.camera.image import CameraImage, in_light
from mkdaemon.vision.camera.imagecodec import frame_of
from mkdaemon.vision.pose.pose import calibration_sd
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.pose.target_check import TargetCheck
from mkdaemon.vision.selfcal.selfcheck import SelfCheck
from mkdaemon.vision.tags.tagmap import Place, Tag, TagMap
from mkdaemon.vision.tags.targetfile import load
from mkdaemon.vision.track.attitude import AttitudeHistory, Mounting
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.track.tracker import Tracker, VisionResult

ALARM_ADVICE = {
    Alarm.WRONG_SIZE: "images and calibration differ in size: set width and height, or calibrate at their size",
    Alarm.WRONG_KIND: "the images are not 8-bit grey values: read the camera in another format",
    Alarm.UNCALIBRATED: "no calibration: tags only, no poses; run mkdaemon calibrate camera and set `calibration`",
    Alarm.FROZEN: "identical images in a row: the camera is frozen, unplug it or restart its driver",
    Alarm.TARGET_MISMATCH: "the tags of a target contradict its file: check sizes and positions, measure the print",
    Alarm.DAMAGED: "images arrive damaged and are refused: check cable, power and bandwidth of USB, or the network",
    Alarm.DARK: "the images are dark: lens cap, light or exposure",
    Alarm.BLOWN: "the images are over-exposed: shorten the exposure or lower the gain",
    Alarm.BLURRED: "edges are wide: clean and focus the lens, shorten the exposure",
    Alarm.LINE_TIME: "the camera file has no `line_time`: run mkdaemon calibrate shutter --store, or write 0 for a"
    " global shutter; until then poses are less certain",
    Alarm.RESIDUAL_DRIFT: "tag edges no longer fit the calibration: calibrate again, check that the print is flat",
}
NEVER_POSED = (Alarm.WRONG_SIZE, Alarm.WRONG_KIND, Alarm.UNCALIBRATED, Alarm.FROZEN)
"""Alarms under which no pose is published, the first one first."""
MAYBE_POSED = (Alarm.DARK, Alarm.BLOWN, Alarm.TARGET_MISMATCH)
"""Alarms that explain why there is no pose, while there is none."""
STATS_EVERY = 1.0
SETUP_EVERY = 10.0
"""What a camera is does not change; a recording that is cut has it all the same [s]."""
FAILING_FROM = 3
"""Failures of the detector in a row from which the camera delivers nothing."""
WINDOW = 150
"""Images the figures look back on: five seconds at 30 Hz."""


class CameraPipeline:
    """Everything that belongs to one camera except its threads.

    Attributes:
        attitude_lost: how often the vehicle's attitude was not used, by reason.
        selfcheck: compares flights with the camera file and the target files.
        reported: the newest figures that were published.

    Raises:
        ConfigError: a camera or target file is wrong, or there is no target.
    """

    def __init__(
        self,
        cfg: CameraSection,
        vision: VisionSection,
        clock: Clock,
        *,
        camera: Camera | None = None,
        tagmap: TagMap | None = None,
    ) -> None:
        """Read the files that `cfg` names.

        Args:
            cfg: of the camera.
            vision: of the tracker.
            clock: stamps.
            camera: contents of a camera file, in place of `cfg.calibration`.
            tagmap: the targets, in place of `cfg.targets`.
        """
        self.cfg, self._clock = cfg, clock
        if camera is None and cfg.calibration is not None:
            camera = load_camera(cfg.calibration)
        if tagmap is None and not cfg.targets:
            msg = f'camera {cfg.name}: no targets; set `targets`, for example ["configs/targets/nested.toml"]'
            raise ConfigError(msg)
        mount = cfg.mount or (camera.mount if camera is not None else None)
        self._mounting = Mounting(mount_rotation(mount), np.array(mount.position_flu)) if mount is not None else None
        self._intrinsics = camera.intrinsics if camera is not None else None
        self._projection = Projection(self._intrinsics) if self._intrinsics is not None else None
        self._gamma = self._intrinsics.gamma if self._intrinsics is not None else 1.0
        self._tagmap = tagmap if tagmap is not None else load(cfg.targets)
        # Without a known mounting the attitude says nothing about the camera: no gate, no prediction from it.
        self.tracker = Tracker(self._tagmap, self._intrinsics, self._mounting, vision.tracker)
        self._places = {target.name: target.places for target in self._tagmap.targets}
        self._check = TargetCheck(self._tagmap, self._projection)
        self._max_attitude_age = vision.tracker.max_attitude_age
        self.attitude_lost: Counter[AttitudeLoss] = Counter()
        self._attitude_alarms: dict[Alarm, str] = {}
        self.selfcheck = SelfCheck(
            self._tagmap,
            camera.model_copy(update={"mount": mount}) if camera is not None else None,
            math.radians(vision.tracker.attitude_sd_deg),
        )
        self._timings: deque[tuple[float, float, bool]] = deque(maxlen=WINDOW)
        """Of each image the time spent [s], its latency [s], and whether there was a pose."""
        self._refused: Counter[PoseRefusal] = Counter()
        self._processed = self._faults = self._failing = self._restarts = 0
        self._failure = ""
        self._result = VisionResult(cfg.name, 0, 0.0, (), (), ())
        self._unchecked: tuple[CameraImage, Array | None, dict[str, float]] | None = None
        """The newest image, the vehicle's attitude then, and its height over each target that was posed [m]."""
        self.reported: VisionStats | None = None
        self._next_jpeg = self._next_stats = self._next_setup = -math.inf

    def process(self, image: CameraImage, attitude: AttitudeHistory | None) -> list[tuple[str, Telemetry]]:
        """Look at the newest image, with the attitude around its exposure; one that makes the detector fail is counted.

        `check_files` comes later: a stick frame waits for this.
        """
        self._processed += 1
        try:
            return self._look(image, attitude)
        except Exception as error:  # noqa: BLE001  # no image may end the thread that looks
            self._failed(error)
            return []

    def look_again(self, image: CameraImage, exposure: ExposureControl | None) -> list[tuple[str, Telemetry]]:
        """Work after the pose: checks of the files, exposure, the published image. No stick frame waits for it."""
        self.check_files()
        if exposure is not None:
            outlines = outlines_of(self._result, self._tagmap, self._projection)
            exposure.image_seen(image.pixels, outlines, self._gamma)
        picture = self.picture(image)
        return [picture] if picture is not None else []

    def check_files(self) -> None:
        """Ask the newest image, once, whether camera file and target files are right; a failure is counted."""
        if self._unchecked is None:
            return
        (image, enu_from_flu, heights), result, self._unchecked = self._unchecked, self._result, None
        try:
            self._check.look(result.detections)
            # rows whose time is unknown would look like another lens
            if result.poses and Alarm.LINE_TIME not in result.alarms:
                seen = {found.target: (found.pose, heights[found.target]) for found in result.poses}
                self.selfcheck.image_seen(in_light(image.pixels, self._gamma), seen, image.captured_at, enu_from_flu)
        except Exception as error:  # noqa: BLE001  # no image may end the thread that looks
            self._note(error)

    def _look(self, image: CameraImage, attitude: AttitudeHistory | None) -> list[tuple[str, Telemetry]]:
        if not math.isfinite(image.captured_at):
            msg = f"image {image.sequence} has no time"
            raise VisionError(msg)
        started = self._clock.now()
        result = self._result = self.tracker.update(image, attitude)
        ready = self._clock.now()
        stamp = self._clock.stamp(image.captured_at)
        values = list(values_of(result, image, stamp, self._mounting, ready, self._places))
        heights = {value.target: value.position_target[2] for _, value in values if isinstance(value, VisionPose)}
        known = attitude.at(image.captured_at, self._max_attitude_age) if attitude is not None else None
        self._unchecked = image, known, heights
        self._judge_attitude(image.captured_at, attitude, known)
        self._refused.update(one.reason for one in result.refused)
        self._timings.append((ready - started, ready - image.captured_at, bool(result.poses)))
        self._failing = 0
        return values

    def _judge_attitude(self, time: float, attitude: AttitudeHistory | None, known: Array | None) -> None:
        """Count an image that was looked at without the attitude that was reported, and say what to do."""
        self._attitude_alarms, off_deg = {}, self.tracker.contradicted_deg
        if self._mounting is None or attitude is None or attitude.is_silent:
            return
        if known is None:
            self.attitude_lost[AttitudeLoss.OUT_OF_REACH] += 1
            away = min((abs(sample.time - time) for sample in attitude.samples), default=None)
            found = "none of the vehicle's attitudes is a number"
            if away is not None:
                found = f"the nearest attitude of the vehicle is {away:.2f} s away from the image"
            self._attitude_alarms[Alarm.ATTITUDE_MISSING] = (
                f"{found}: poses come from the images alone; check the link to the boards and the camera's stamps"
            )
        elif off_deg is not None:
            self.attitude_lost[AttitudeLoss.CONTRADICTS] += 1
            self._attitude_alarms[Alarm.ATTITUDE_CONTRADICTS] = (
                f"roll and pitch of the vehicle are {off_deg:.0f} deg off what the images show of a level"
                " target: poses come from the images alone; check the camera's mount, the signs of the attitude, and"
                " `level` of the target"
            )

    def restarted(self, error: BaseException) -> None:
        """Count a restart of the thread that looks, and what ended it."""
        self._restarts += 1
        self._failed(error)

    def _failed(self, error: BaseException) -> None:
        """Note a failure of the detector, and forget what it followed."""
        self._note(error)
        self._failing += 1
        self._timings.clear()
        self.tracker.reset()

    def _note(self, error: BaseException) -> None:
        self._faults += 1
        self._failure = f"{type(error).__name__}: {error}"

    def picture(self, image: CameraImage) -> tuple[str, Telemetry] | None:
        """The image as JPEG, when one is due."""
        if self.cfg.jpeg_hz <= 0.0 or image.received_at < self._next_jpeg:
            return None
        period = 1.0 / self.cfg.jpeg_hz
        self._next_jpeg = max(self._next_jpeg + period, image.received_at + 0.5 * period)
        stamp = self._clock.stamp(image.captured_at)
        return f"vision/{image.camera}/image", frame_of(image, stamp, self.cfg.jpeg_quality, self.cfg.jpeg_width)

    def mount(self, stamp: Stamp) -> Transform | None:
        """The camera in the body; None if its mounting is unknown."""
        at = self._mounting
        if at is None:
            return None
        return transform("body", camera_frame(self.cfg.name), at.flu_from_cam, at.position_flu, stamp, static=True)

    def setup(self, stamp: Stamp) -> CameraSetup:
        """Properties and targets of the camera, from its files."""
        return setup_of(self.cfg.name, self._intrinsics, self._mounting, self._tagmap, stamp)

    def report(self, stream: StreamStatus, stamp: Stamp) -> list[tuple[str, Telemetry]]:
        """Stats and the static frame, once a second and when the state changes; now and then what the camera is."""
        facts, last = (self.state(stream)[0], *self.alarms(stream)), self.reported
        if last is not None and (last.state, *last.alarms) == facts and stamp.monotonic < self._next_stats:
            return []
        self.reported, self._next_stats = self.stats(stream, stamp), stamp.monotonic + STATS_EVERY
        values: list[tuple[str, Telemetry]] = [(f"vision/{self.cfg.name}/stats", self.reported)]
        mount = self.mount(stamp)
        values += [("tf", mount)] if mount is not None else []
        if stamp.monotonic >= self._next_setup:
            self._next_setup = stamp.monotonic + SETUP_EVERY
            values.append((f"vision/{self.cfg.name}/setup", self.setup(stamp)))
        return values

    def stats(self, stream: StreamStatus, stamp: Stamp) -> VisionStats:
        """Figures of the last images, and what is known of the camera now."""
        state, reason = self.state(stream)
        figures = np.array(self._timings or [(0.0, 0.0, False)])
        (detect_p50, latency_p50), (detect_p99, latency_p99) = 1000.0 * np.percentile(figures[:, :2], (50, 99), axis=0)
        return VisionStats(
            **stream._replace(state=state, reason=reason)._asdict(),
            camera=self.cfg.name,
            stamp=stamp,
            alarms=self.alarms(stream),
            source=self.cfg.source,
            processed=self._processed,
            faults=self._faults,
            restarts=self._restarts,
            posed=float(figures[:, 2].mean()),
            refused={reason.value: count for reason, count in self._refused.items()},
            attitude_lost=dict(self.attitude_lost),
            detect_p50_ms=float(detect_p50),
            detect_p99_ms=float(detect_p99),
            latency_p50_ms=float(latency_p50),
            latency_p99_ms=float(latency_p99),
            exposure=exposure_of(stream.control) if stream.control is not None else None,
            selfcal=self.selfcheck.reports(),
        )

    def state(self, stream: StreamStatus) -> tuple[EyeState, str]:
        """The first thing between the camera and a pose, with what to do; poor light only while nothing is posed."""
        if stream.state is not EyeState.OK:
            return stream.state, stream.reason
        if self._failing >= FAILING_FROM:
            return EyeState.FAILING, f"the detector failed on the last {self._failing} images ({self._failure})"
        alarms, posed = self.alarms(stream), bool(self._timings) and self._timings[-1][2]
        for name in NEVER_POSED if posed else (*NEVER_POSED, *MAYBE_POSED):
            if name in alarms:
                return EyeState(name.value), alarms[name]
        return EyeState.OK, ""

    def alarms(self, stream: StreamStatus) -> dict[Alarm, str]:
        """Faults of the images, the camera file or a target file, each with a remedy."""
        raised = [*self._result.alarms]
        raised += [Alarm.TARGET_MISMATCH] if self._check.contradicted else []
        raised += [Alarm.DAMAGED] if stream.damage else []
        k, shutter = self._intrinsics, self.tracker.shutter
        figures = {
            Alarm.WRONG_SIZE: k and f" ({stream.width}x{stream.height}, its calibration is for {k.width}x{k.height})",
            Alarm.LINE_TIME: shutter and f"; it is {shutter.words}",
            Alarm.DAMAGED: f" ({stream.damage})",
        }
        seen = {name: ALARM_ADVICE[name] + (figures.get(name) or "") for name in raised}
        return seen | self.selfcheck.alarms | self._attitude_alarms


def camera_frame(name: str) -> str:
    """Name of a camera's frame in `tf`."""
    return f"camera/{name}"


def values_of(
    result: VisionResult,
    image: CameraImage,
    stamp: Stamp,
    mounting: Mounting | None,
    ready_at: float,
    places: Mapping[str, Sequence[Place]],
) -> Iterator[tuple[str, Telemetry]]:
    """Key suffixes and values of an image of `stamp`, looked at by `ready_at` [s]; no poses without a mounting.

    A target is also published against each of its `places`, by its name: a place is a target to whatever flies by it.
    """
    if result.detections:
        tags = tuple(
            TagSighting(
                family=found.family,
                id=found.tag_id,
                hamming=found.hamming,
                decision_margin=found.decision_margin,
                corners=found.corners.tolist(),
                search=found.view,
            )
            for found in result.detections
        )
        yield f"vision/{image.camera}/tags", Tags(**_seen(image, stamp), tags=tags)
    for one in result.refused:
        yield (
            f"vision/{image.camera}/refused",
            PoseRefused(
                **_seen(image, stamp),
                target=one.target,
                refusal=one.reason,
                decode_age=one.decode_age,
                has_attitude=result.has_attitude,
            ),
        )
    if mounting is None:
        return
    for pose in (each for one in result.poses for each in (one, *map(one.seen_from, places.get(one.target, ())))):
        yield f"vision/{image.camera}/pose", pose_of(pose, image, stamp, mounting, ready_at)
        yield "tf", transform(camera_frame(image.camera), pose.frame, pose.pose.rotation, pose.pose.position, stamp)


def pose_of(found: TargetPose, image: CameraImage, stamp: Stamp, mounting: Mounting, ready_at: float) -> VisionPose:
    """A pose both ways round, with the covariance carried from camera to body."""
    target_from_cam, camera_target, covariance = found.camera_in_target()
    target_from_flu = target_from_cam @ mounting.flu_from_cam.T
    arm = -target_from_flu @ mounting.position_flu
    vehicle_target = camera_target + arm
    # A small turn w (target axes) moves the body by w x arm.
    carry = np.eye(6)
    carry[:3, 3:] = -skew(arm)
    return VisionPose(
        **_seen(image, stamp),
        target=found.target,
        position_target=vehicle_target.tolist(),
        quaternion_target_from_flu=quaternion_from_rotation(target_from_flu),
        position_flu=(-target_from_flu.T @ vehicle_target).tolist(),
        quaternion_flu_from_target=quaternion_from_rotation(target_from_flu.T),
        covariance=(carry @ covariance @ carry.T).ravel().tolist(),
        calibration_sd=calibration_sd(found.measured),
        position_cam=found.pose.position.tolist(),
        quaternion_cam_from_target=quaternion_from_rotation(found.pose.rotation),
        source=found.pose.source,
        mode=found.mode,
        points=found.pose.points,
        rms_px=found.pose.rms_px,
        ambiguity=found.ratio if np.isfinite(found.ratio) else None,
        decided_by=found.decided_by,
        decode_age=max(found.decode_age, 0.0),
        delivered=image.received_at - image.captured_at,
        latency=ready_at - image.captured_at,
        is_of_map=found.is_of_map,
    )


def transform(
    parent: str, child: str, parent_from_child: Array, position: Array, stamp: Stamp, *, static: bool = False
) -> Transform:
    """One edge of the tree of frames."""
    turn = quaternion_from_rotation(parent_from_child)
    return Transform(
        parent=parent, child=child, stamp=stamp, translation=position.tolist(), quaternion=turn, static=static
    )


def _seen(image: CameraImage, stamp: Stamp) -> dict[str, object]:
    return {"camera": image.camera, "sequence": image.sequence, "stamp": stamp, "stamped_by": image.stamped_by}


def exposure_of(control: ExposureControl) -> Exposure:
    """Exposure settings, and the image levels that they follow from."""
    levels = dict.fromkeys(("black", "white", "noise")) if control.levels is None else control.levels._asdict()
    return Exposure(exposure_ms=1000.0 * control.setting.exposure, gain=control.setting.gain, **levels)


def outlines_of(result: VisionResult, tagmap: TagMap, projection: Projection | None) -> list[Array]:
    """Corners `(4, 2)` [px] of all tags of an image: decoded ones, and those of posed targets that are in front."""
    found = [detection.corners for detection in result.detections]
    if projection is None:
        return found
    posed = {pose.target: pose.pose for pose in result.poses}
    for pose, tag in ((posed[owner.name], tag) for owner, tag in tagmap.owners.values() if owner.name in posed):
        corners, visible = projection.project(tag.corners @ pose.rotation.T + pose.position)
        if visible.all():
            found.append(corners)
    return found


def setup_of(
    camera: str, intrinsics: Intrinsics | None, mounting: Mounting | None, tagmap: TagMap, stamp: Stamp
) -> CameraSetup:
    """Properties and targets of a camera; no lens without a calibration, no place without a mounting."""
    lens = None
    if intrinsics is not None:
        lens = LensShape(**intrinsics.model_dump(), distortion=intrinsics.distortion.tolist())
    return CameraSetup(
        stamp=stamp,
        camera=camera,
        lens=lens,
        position_flu=None if mounting is None else mounting.position_flu.tolist(),
        quaternion_flu_from_cam=None if mounting is None else quaternion_from_rotation(mounting.flu_from_cam),
        targets=tuple(
            TargetShape(name=target.name, moving=target.moving, tags=tuple(map(_tag_shape, target.tags)))
            for one in tagmap.targets
            for target in (one, *map(one.seen_from, one.places))
        ),
    )


def _tag_shape(tag: Tag) -> TagShape:
    rows = tuple("".join("." if cell else "#" for cell in row) for row in tag.bitmap)
    return TagShape(family=tag.family.name, id=tag.tag_id, corners=tag.outline.tolist(), cells=rows)

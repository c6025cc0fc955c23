"""One camera's images through its tracker, with the figures that tell how well it goes.

How much of the vehicle's attitude the eyes can use: what was left out is counted by reason, and told.
"""

from __future__ import annotations

import math
from collections import Counter, deque

import numpy as np

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.vision import Alarm, AttitudeLoss, CameraSetup, EyeState, PoseRefusal, Transform, VisionStats
from mkdaemon.vision.camera.calibration_file import load_camera, mount_rotation
from mkdaemon.vision.camera.camera import StreamStatus
from mkdaemon.vision.camera.exposure import ExposureControl, Reach, Setting, first_setting
from mkdaemon.vision.camera.image import CameraImage, in_light
from mkdaemon.vision.camera.imagecodec import encode_jpeg
from mkdaemon.vision.output import exposure_of, height_over, mount_transform, outlines_of, setup_of, values_of
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.target_check import TargetCheck
from mkdaemon.vision.selfcal.selfcheck import SelfCheck
from mkdaemon.vision.tags.tagmap import load
from mkdaemon.vision.track.attitude import AttitudeHistory, Mounting
from mkdaemon.vision.track.result import VisionResult
from mkdaemon.vision.track.tracker import Tracker

ALARM_ADVICE = {
    Alarm.WRONG_SIZE: "images and calibration differ in size: set width and height, or calibrate at this size",
    Alarm.WRONG_KIND: "the images are no grey values of 8 bits: read the camera in another format",
    Alarm.UNCALIBRATED: "no calibration: tags only, no poses; run mkdaemon calibrate camera and set `calibration`",
    Alarm.FROZEN: "equal images in a row: the camera is frozen, unplug it or restart its driver",
    Alarm.TARGET_MISMATCH: "the tags of a target contradict its file: check sizes and positions, measure the print",
    Alarm.DAMAGED: "images arrive damaged and are refused: check cable, power and bandwidth of USB, or the network",
    Alarm.DARK: "the images are dark: lens cap, light or exposure",
    Alarm.BLOWN: "the images are over-exposed: shorten the exposure or lower the gain",
    Alarm.BLURRED: "edges are wide: clean and focus the lens, shorten the exposure",
    Alarm.LINE_TIME: "the camera file has no `line_time`: run mkdaemon calibrate shutter --store, or write 0 for a"
    " global shutter; until then poses are less certain",
    Alarm.RESIDUAL_DRIFT: "tag edges no longer fit the calibration: calibrate again, check that the print is flat",
}
"""What to do about an alarm."""
NEVER_POSED = (Alarm.WRONG_SIZE, Alarm.WRONG_KIND, Alarm.UNCALIBRATED, Alarm.FROZEN)
"""Alarms under which no pose is published, the first one first."""
MAYBE_POSED = (Alarm.DARK, Alarm.BLOWN, Alarm.TARGET_MISMATCH)
"""Alarms that explain why there is no pose, while there is none."""
FAILING_FROM = 3
"""Failures of the detector in a row from which the camera delivers nothing."""
AT_BODY = Mounting(np.eye(3), np.zeros(3))
"""How a camera is taken to sit of which nobody said it: its axes are those of the body."""
WINDOW = 150
"""Images the figures look back on: five seconds at 30 Hz."""


class CameraPipeline:
    """Everything that belongs to one camera except its threads.

    Raises:
        ConfigError: a camera or target file is wrong, or there is no target.
    """

    def __init__(self, cfg: CameraSection, vision: VisionSection, clock: Clock) -> None:
        self.cfg = cfg
        self._clock = clock
        camera = load_camera(cfg.calibration) if cfg.calibration is not None else None
        if not cfg.targets:
            msg = f'camera {cfg.name}: no targets; set `targets`, for example ["configs/targets/nested.toml"]'
            raise ConfigError(msg)
        mount = cfg.mount or (camera.mount if camera is not None else None)
        self._mounting = Mounting(mount_rotation(mount), np.array(mount.position_flu)) if mount is not None else None
        self._intrinsics = camera.intrinsics if camera is not None else None
        self._projection = Projection(self._intrinsics) if self._intrinsics is not None else None
        self._gamma = self._intrinsics.gamma if self._intrinsics is not None else 1.0
        self._tagmap = load(cfg.targets)
        # Without a known mounting the attitude says nothing about the camera: no gate, no prediction from it.
        self.tracker = Tracker(self._tagmap, self._intrinsics, self._mounting, vision.tracker)
        self._check = TargetCheck(self._tagmap, self._projection)
        self._max_attitude_age = vision.tracker.max_attitude_age
        self._attitude_lost: Counter[AttitudeLoss] = Counter()
        self._attitude_alarms: dict[Alarm, str] = {}
        self._selfcheck = SelfCheck(
            self._tagmap,
            camera.model_copy(update={"mount": mount}) if camera is not None else None,
            math.radians(vision.tracker.attitude_sd_deg),
            has_mount=mount is not None,
        )
        self._timings: deque[tuple[float, float, bool]] = deque(maxlen=WINDOW)
        """Of each image the time spent [s], its latency [s], and whether there was a pose."""
        self._refused: Counter[PoseRefusal] = Counter()
        self._processed = self._faults = self._failing = 0
        self._failure = ""
        self._result: VisionResult | None = None
        self._unchecked: tuple[CameraImage, AttitudeHistory | None] | None = None
        self._exposure: ExposureControl | None = None
        self._next_jpeg = -np.inf

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """What is wrong with the images, the camera file or a target file."""
        seen = self._result.alarms if self._result is not None else ()
        mismatch = (Alarm.TARGET_MISMATCH,) if self._check.contradicted else ()
        return (*seen, *mismatch, *self._selfcheck.alarms, *self._attitude_alarms)

    def process(self, image: CameraImage, attitude: AttitudeHistory | None) -> list[tuple[str, Telemetry]]:
        """Look at the newest image, with the attitude around its exposure; one that makes the detector fail is counted.

        Whether it contradicts the camera file or a target file is left to `check_files`: a stick frame waits for this.
        """
        self._processed += 1
        try:
            values = self._look(image, attitude)
        except Exception as error:  # noqa: BLE001  # no image may end the thread that looks
            self.failed(error)
            return []
        self._failing = 0
        return values

    def check_files(self) -> None:
        """Ask the newest image, once, whether camera file and target files are right; a failure is counted."""
        unchecked, result, self._unchecked = self._unchecked, self._result, None
        if unchecked is None or result is None:
            return
        image, attitude = unchecked
        try:
            self._check.look(result.detections)
            # rows whose time is unknown would look like another lens
            if result.poses and Alarm.LINE_TIME not in result.alarms:
                known = attitude.at(image.captured_at, self._max_attitude_age) if attitude is not None else None
                over = self._mounting or AT_BODY
                seen = {found.target: (found.pose, height_over(found, over)) for found in result.poses}
                self._selfcheck.image_seen(in_light(image.pixels, self._gamma), seen, image.captured_at, known)
        except Exception as error:  # noqa: BLE001  # no image may end the thread that looks
            self._note(error)

    def _look(self, image: CameraImage, attitude: AttitudeHistory | None) -> list[tuple[str, Telemetry]]:
        if not math.isfinite(image.captured_at):
            msg = f"image {image.sequence} has no time"
            raise VisionError(msg)
        started = self._clock.now()
        result = self.tracker.update(image, attitude)
        ready = self._clock.now()
        self._result, self._unchecked = result, (image, attitude)
        values = list(values_of(result, image, self._clock.stamp(image.captured_at), self._mounting or AT_BODY, ready))
        self._judge_attitude(image.captured_at, attitude)
        self._refused.update(reason for _, reason in result.refused)
        self._timings.append((ready - started, ready - image.captured_at, bool(result.poses)))
        return values

    def _judge_attitude(self, time: float, attitude: AttitudeHistory | None) -> None:
        """Count an image that was looked at without the attitude that was reported, and say what to do."""
        self._attitude_alarms, off_deg = {}, self.tracker.contradicted_deg
        if self._mounting is None or attitude is None or attitude.is_silent:
            return
        if attitude.at(time, self._max_attitude_age) is None:
            self._attitude_lost[AttitudeLoss.OUT_OF_REACH] += 1
            found = "none of the vehicle's attitudes is a number"
            if attitude.samples:
                away = min(abs(sample.time - time) for sample in attitude.samples)
                found = f"the nearest attitude of the vehicle is {away:.2f} s away from the image"
            self._attitude_alarms[Alarm.ATTITUDE_MISSING] = (
                f"{found}: poses come from the images alone; check the link to the boards and the camera's stamps"
            )
        elif off_deg is not None:
            self._attitude_lost[AttitudeLoss.CONTRADICTS] += 1
            self._attitude_alarms[Alarm.ATTITUDE_CONTRADICTS] = (
                f"roll and pitch of the vehicle are {off_deg:.0f} deg off what the images show of a level"
                " target: poses come from the images alone; check the camera's mount, the signs of the attitude, and"
                " `level` of the target"
            )

    def choose_setting(self, image: CameraImage, reach: Reach | None) -> Setting | None:
        """What the camera is told so that it exposes the tags well; none for no change, or where it takes nothing."""
        if reach is None:
            self._exposure = None
            return None
        if self._exposure is None or self._exposure.reach != reach:
            self._exposure = ExposureControl(reach, first_setting(reach), self._gamma)
            return self._exposure.setting
        outlines = outlines_of(self._result, self._tagmap, self._projection) if self._result is not None else []
        return self._exposure.image_seen(image.pixels, outlines)

    def barometer_received(self, time: float, height: float) -> None:
        """Take the barometer's height [m] at a time [s; monotonic]."""
        self._selfcheck.barometer_received(time, height)

    def failed(self, error: BaseException) -> None:
        """Count a failure of the detector, by what it raised, and forget what it followed."""
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
        pixels, width, height = encode_jpeg(image.pixels, self.cfg.jpeg_quality, self.cfg.jpeg_width)
        frame = CameraFrame(
            camera=image.camera,
            sequence=image.sequence,
            width=width,
            height=height,
            coding="jpeg",
            stamp=self._clock.stamp(image.captured_at),
            pixels=pixels,
        )
        return f"vision/{image.camera}/image", frame

    def mount(self, stamp: Stamp) -> Transform | None:
        """The camera in the body; None where nobody said how it sits."""
        return mount_transform(self.cfg.name, self._mounting, stamp) if self._mounting is not None else None

    def setup(self, stamp: Stamp) -> CameraSetup:
        """What the camera is and looks for, from its files."""
        return setup_of(self.cfg.name, self._intrinsics, self._mounting, self._tagmap, stamp)

    def stats(self, stream: StreamStatus, stamp: Stamp, restarts: int = 0, not_numbers: int = 0) -> VisionStats:
        """Figures of the last images.

        Args:
            stream: of the camera.
            stamp: now.
            restarts: of the thread that looks.
            not_numbers: attitude samples that are none.
        """
        state, reason = self.state(stream)
        damaged = (Alarm.DAMAGED,) if stream.damage else ()
        advice = ALARM_ADVICE | self._selfcheck.alarms | self._attitude_alarms
        if Alarm.LINE_TIME in self.alarms and self.tracker.shutter is not None:
            advice[Alarm.LINE_TIME] += f"; it is {self.tracker.shutter.words}"
        if damaged:
            advice[Alarm.DAMAGED] += f" ({stream.damage})"
        figures = np.array(self._timings or [(0.0, 0.0, False)])
        (detect_p50, latency_p50), (detect_p99, latency_p99) = 1000.0 * np.percentile(figures[:, :2], (50, 99), axis=0)
        return VisionStats(
            camera=self.cfg.name,
            stamp=stamp,
            state=state,
            reason=reason,
            alarms={name: advice[name] for name in (*self.alarms, *damaged)},
            source=self.cfg.source,
            width=stream.width,
            height=stream.height,
            fps=stream.fps,
            processed=self._processed,
            dropped=stream.dropped,
            lost=stream.lost,
            damaged=stream.damaged,
            reopened=stream.reopened,
            faults=self._faults,
            restarts=restarts,
            posed=float(figures[:, 2].mean()),
            refused={reason.value: count for reason, count in self._refused.items()},
            attitude_lost=dict(self._attitude_lost) | ({AttitudeLoss.NOT_A_NUMBER: not_numbers} if not_numbers else {}),
            detect_p50_ms=float(detect_p50),
            detect_p99_ms=float(detect_p99),
            latency_p50_ms=float(latency_p50),
            latency_p99_ms=float(latency_p99),
            settings_refused=stream.refused,
            detector=self.tracker.detector.warning or self.tracker.detector.backend,
            exposure=exposure_of(self._exposure) if self._exposure is not None else None,
            selfcal=self._selfcheck.reports(),
        )

    def state(self, stream: StreamStatus) -> tuple[EyeState, str]:
        """The first thing between the camera and a pose, with what to do; poor light only while nothing is posed."""
        if stream.state is not EyeState.OK:
            return stream.state, stream.reason
        if self._failing >= FAILING_FROM:
            return EyeState.FAILING, f"the detector failed on the last {self._failing} images ({self._failure})"
        posed = bool(self._timings) and self._timings[-1][2]
        for name in NEVER_POSED if posed else (*NEVER_POSED, *MAYBE_POSED):
            if name in self.alarms:
                k, words = self._intrinsics, ALARM_ADVICE[name]
                if name is Alarm.WRONG_SIZE and k is not None:
                    sizes = f"{stream.width}x{stream.height}, its calibration is for {k.width}x{k.height}"
                    words = f"the camera gives {sizes}: set width and height, or calibrate at this size"
                return EyeState(name.value), words
        return EyeState.OK, ""

"""Watches one camera fly: whether images, attitude and barometer agree with its camera file and its target files.

What tells a wrong print or focal length where there is no barometer, 2 % of it in flights of docs/accuracy.md: two tags
whose ratio the file knows tell the size of one against the other to 0.2 %, in every descent; the foreshortening of a
tag that is seen at a slant, against itself from several ranges, the focal length to 0.5 %, in 17 descents of 22, to
1.4 % behind a webcam. A print whose sizes are all wrong by one factor looks like one that is farther away, from every
range: nothing in the images tells it.

The unknowns, estimated together: the turn of the mounting about body forward, left, up [rad], the horizontal part of
the target's normal, east and north, the share by which the vehicle reports too much tilt; then those of the images
(`ImageEvidence`).
A mounting turns with the vehicle, a deck does not: without yaw only their sum is seen, and the deviations say so. What
is constant in the vehicle's own attitude counts as mounting. A lens that is too long turns poses near the rim of the
image, which the attitude contradicts.

With n the normal that an image shows, in body axes, and E the attitude, the horizontal part of the normal in the world
is y = E n. Were the mounting turned by m, the lens or a size changed by p, the deck d and the scale k, it would be
y = d - E (m x n) - E M (T p x n_cam) + k E e_z, with T the turn of a pose with lens and sizes.

Heights over a target, as the eyes see them, against the barometer: on ways down and up their scales must agree.

With z the height by the eyes, e the share of it that is too much, b the barometer, a its offset and L its delay,
b = a + z - e z - L dz/dt. The offset wanders, so slow flights say little, and a hover nothing. Two hypotheses are
compared: e is what a calibration and a measured print leave, or it is anything. Their odds are a Bayes factor.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import exp, hypot, log, radians
from typing import Final

import cv2
import numpy as np

from mkdaemon.config.camera import MountSection
from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.telemetry.selfcal import HEIGHTS_LIKELY, SelfCalibration, TagSizeError
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.calibration_file import Camera, mount_rotation
from mkdaemon.vision.limits import LIMITS, SELFCAL
from mkdaemon.vision.pose.bend import Bend
from mkdaemon.vision.pose.pose import FLOOR_RANGE, Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.selfcal.evidence import LENS, EvidenceMaker, ImageEvidence
from mkdaemon.vision.tags.tagmap import Tag, TagMap, Target

LENS_SD: Final = (0.03, 10.0, 10.0, 0.05)
"""How far a calibration may be off, deviations: 3 % of the focal length, 10 px, 0.05."""
MOUNTING_SD: Final = np.radians(5.0)
DECK_SD: Final = np.radians(2.5)
"""As `PRIOR_SD` of `track.level`."""
TILT_SCALE_SD: Final = 0.08
"""Real gyros: attitudes of 0.89 to 1.13 times the truth."""
MOUNTING_DRIFT: Final = np.radians(0.02)
"""Of the mounting with the attitude's bias, random walk [rad/sqrt(s)]: 0.2 degrees in 100 s."""
DECK_DRIFT: Final = {False: np.radians(0.02), True: np.radians(2.0)}
"""Of the target's normal, by whether it moves [rad/sqrt(s)]."""
ALIKE_TIME: Final = 0.2
"""For so long errors of the attitude are one error [s]: images that follow sooner weigh less."""
SOONEST: Final = 0.01
"""Images that follow sooner count as so far apart [s]."""
LONGEST: Final = 10.0
"""A longer time without an image counts as so much [s]."""
SIZE_SD: Final = 0.03
"""How far a tag's size may be off, logarithm."""
MELT_SD: Final = 0.008
"""By how much a tag of the smallest readable cells may look smaller or larger, logarithm; one error of all images."""
MOUNTING: Final = slice(0, 3)
DECK: Final = slice(3, 5)
TILT_SCALE: Final = 5
LENS_AT: Final = 6
SIZES_AT: Final = LENS_AT + len(LENS)


class CameraFilter:
    """A Kalman filter of what is constant, or nearly so, about one camera and one target.

    Args:
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].
        flu_from_cam: the mounting believed `(3, 3)`; none says nothing about attitude.
        is_level: whether the target lies level at rest.
        is_moving: whether it moves.
        sizes: how many unknown sizes the images speak of, melting apart.
        bend: what is known of that of its print; none where it does not bend.

    Attributes:
        mean: of the unknowns `(n,)`.
        covariance: of them `(n, n)`.
        looks: images taken in.
    """

    def __init__(
        self,
        attitude_sd: float,
        flu_from_cam: Array | None,
        *,
        is_level: bool,
        is_moving: bool,
        sizes: int,
        bend: Bend | None = None,
    ) -> None:
        self._attitude_sd = attitude_sd
        self._flu_from_cam = flu_from_cam if is_level else None
        self._deck_drift = DECK_DRIFT[is_moving]
        rises = np.zeros(0 if bend is None else len(bend.mean))
        sd = np.array(
            [*[MOUNTING_SD] * 3, *[DECK_SD] * 2, TILT_SCALE_SD, *LENS_SD, *[SIZE_SD] * sizes, MELT_SD, *rises]
        )
        self.mean: Array = np.zeros(len(sd))
        self.covariance: Array = np.diag(sd**2)
        if bend is not None:
            self.mean[-len(bend.mean) :] = bend.mean
            self.covariance[-len(bend.mean) :, -len(bend.mean) :] = bend.covariance
        self.looks = 0
        self._time: float | None = None

    @property
    def sd(self) -> Array:
        """Standard deviations `(n,)`."""
        deviations: Array = np.sqrt(np.diag(self.covariance))
        return deviations

    def image_seen(self, time: float, evidence: ImageEvidence, enu_from_flu: Array | None) -> None:
        """Take in what an image says, the middle of its exposure [s], and the attitude `(3, 3)` then, if known."""
        spent = 0.0 if self._time is None else min(max(time - self._time, 0.0), LONGEST)
        self._time = time
        self.looks += 1
        drift = np.zeros(len(self.mean))
        drift[MOUNTING], drift[DECK] = MOUNTING_DRIFT, self._deck_drift
        before = np.linalg.inv(self.covariance + spent * np.diag(drift**2))
        after, right = before.copy(), before @ self.mean
        after[LENS_AT:, LENS_AT:] += evidence.matrix
        right[LENS_AT:] += evidence.pull
        self.covariance = np.linalg.inv(after)
        self.mean = self.covariance @ right
        if enu_from_flu is not None and self._flu_from_cam is not None:
            self._normal_seen(evidence, enu_from_flu, self._flu_from_cam, spent)

    def _normal_seen(self, evidence: ImageEvidence, enu_from_flu: Array, flu_from_cam: Array, spent: float) -> None:
        enu_from_cam = enu_from_flu @ flu_from_cam
        normal_cam = evidence.rotation[:, 2]
        # a small turn w moves the normal n by w x n = -[n]x w
        moved_cam = (-enu_from_cam @ skew(normal_cam))[:2]
        moved_flu = (-enu_from_flu @ skew(flu_from_cam @ normal_cam))[:2]
        observe = np.zeros((2, len(self.mean)))
        observe[:, LENS_AT:] = -moved_cam @ evidence.turn
        observe[:, MOUNTING] = -moved_flu
        observe[:, DECK] = np.eye(2)
        observe[:, TILT_SCALE] = enu_from_flu[:2, 2]
        shared = max(ALIKE_TIME / max(spent, SOONEST), 1.0)
        noise = moved_cam @ evidence.covariance @ moved_cam.T + self._attitude_sd**2 * shared * np.eye(2)
        self.mean, self.covariance = _measured(
            self.mean, self.covariance, (enu_from_cam @ normal_cam)[:2], observe, noise
        )


def _measured(mean: Array, covariance: Array, value: Array, observe: Array, noise: Array) -> tuple[Array, Array]:
    """Mean and covariance of a Kalman filter after a value `(m,)`, seen by `observe` `(m, n)` with `noise` `(m, m)`."""
    gain = covariance @ observe.T @ np.linalg.inv(observe @ covariance @ observe.T + noise)
    kept = covariance - gain @ observe @ covariance
    return mean + gain @ (value - observe @ mean), (kept + kept.T) / 2


SCALE_SD: Final = 0.5
"""How far heights may be off, deviation: a size may be that of another print."""
DELAY: Final = (0.15, 0.1)
"""Of a barometer's height when it arrives here, mean and deviation [s]."""
OFFSET_SD: Final = 100.0
"""Of the two zeros [m]: nothing is known."""
WANDER: Final = 0.067
"""Of a barometer, random walk [m/sqrt(s)]: 0.15 m with 10 s of correlation, as the simulator's."""
READING_SD: Final = 0.03
"""Of one reading [m]: steps of 5 cm."""
LOWEST: Final = 0.7
"""Below, the rotors' own pressure is on the barometer [m]."""
LEAST_CHANGE: Final = 0.1
"""A barometer that lives changes by so much on a way [m]: two of its steps, or one of the coarse ones."""
LONGEST_GAP: Final = 0.5
"""Between two poses that a reading lies between [s]."""
PAUSE: Final = 5.0
"""Without both for so long the offset is unknown again [s]."""
KEPT: Final = 50
"""Readings that wait for the next pose."""


class HeightFilter:
    """Compares the heights over one target with those of the barometer."""

    def __init__(self) -> None:
        self._mean: Array = np.array([0.0, 0.0, DELAY[0]])
        self._covariance: Array = np.diag(np.array([OFFSET_SD, SCALE_SD, DELAY[1]]) ** 2)
        self._waiting: list[tuple[float, float]] = []
        self._last: tuple[float, float] | None = None
        self._compared_at: float | None = None
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    @property
    def scale(self) -> tuple[float, float]:
        """Share by which the eyes' heights are too large, and its deviation."""
        return float(self._mean[1]), float(np.sqrt(self._covariance[1, 1]))

    @property
    def odds(self) -> float:
        """Decimal logarithm of the odds that heights are wrong, against right ones; 0 where nothing is known.

        What was read says of the share e what a normal distribution about m with deviation s says, once the belief
        before it is taken out; integrated over what e may be, that is the density of m with both variances. A barometer
        that does not move is dead, and says nothing.
        """
        share, sd = self.scale
        left = 1.0 / sd**2 - 1.0 / SCALE_SD**2
        if self._high[1] - self._low[1] < LEAST_CHANGE or left <= 0.0:
            return 0.0
        mean, variance = share / (sd**2 * left), 1.0 / left
        wrong, right = variance + SCALE_SD**2, variance + 2 * SELFCAL.share**2
        return (mean**2 * (1.0 / right - 1.0 / wrong) - log(wrong / right)) / 2.0 / log(10.0)

    @property
    def contradicts(self) -> bool:
        """Whether the barometer says that heights are wrong, and by no accident."""
        return self.odds >= HEIGHTS_LIKELY

    @property
    def covered(self) -> float:
        """Between the lowest and the highest height that was compared [m]."""
        return max(float(self._high[0] - self._low[0]), 0.0)

    def reading_received(self, time: float, height: float) -> None:
        """Take the barometer's height [m] at a time [s]; it counts when the next pose is there."""
        self._waiting = [*self._waiting[1 - KEPT :], (time, height)]

    def pose_seen(self, time: float, height: float) -> None:
        """Take the eyes' height over the target [m] at a time [s]."""
        before, self._last = self._last, (time, height)
        if before is None or not 0.0 < time - before[0] < LONGEST_GAP:
            return
        due = [reading for reading in self._waiting if before[0] <= reading[0] < time]
        self._waiting = [reading for reading in self._waiting if reading[0] >= time]
        speed = (height - before[1]) / (time - before[0])
        for at, barometer in due:
            here = before[1] + speed * (at - before[0])
            if here > LOWEST:
                self._compare(at, here, speed, barometer)

    def _compare(self, time: float, height: float, speed: float, barometer: float) -> None:
        spent = 0.0 if self._compared_at is None else max(time - self._compared_at, 0.0)
        self._compared_at = time
        if spent > PAUSE:
            self._covariance[0, :] = self._covariance[:, 0] = 0.0
            self._covariance[0, 0] = OFFSET_SD**2
        self._covariance[0, 0] += WANDER**2 * spent
        self._low, self._high = np.minimum(self._low, (height, barometer)), np.maximum(self._high, (height, barometer))
        value, noise = np.array([barometer - height]), np.array([[READING_SD**2]])
        observe = np.array([[1.0, -height, -speed]])
        self._mean, self._covariance = _measured(self._mean, self._covariance, value, observe, noise)


def turned_rpy_deg(mount: MountSection, turn: Array) -> tuple[float, float, float]:
    """Angles of a mount [deg] after a turn by the rotation vector `(3,)` [rad; body], `rpy_deg` of the camera file."""
    roll, pitch, yaw = (radians(angle) for angle in mount.rpy_deg)
    after = np.asarray(cv2.Rodrigues(turn.reshape(3, 1))[0]) @ rotation_from_euler(roll, pitch, yaw)
    roll, pitch, yaw = (float(np.degrees(angle)) for angle in euler_from_rotation(after))
    return roll, pitch, yaw


class TargetWatch:
    """What one target says about a camera; see `SelfCheck`."""

    def __init__(self, target: Target, camera: Camera, attitude_sd: float, *, has_mount: bool) -> None:
        self.target = target
        self._camera = camera
        self._maker = EvidenceMaker(target, Projection(camera.intrinsics))
        self._filter = CameraFilter(
            attitude_sd,
            mount_rotation(camera.mount) if has_mount else None,
            is_level=target.level,
            is_moving=target.moving,
            sizes=self._maker.unknown_sizes,
            bend=None if self._maker.sheet is None else self._maker.sheet.prior,
        )
        self.heights = HeightFilter()
        self._due = -np.inf

    def image_seen(self, pixels: Grey, pose: Pose, time: float, enu_from_flu: Array | None) -> None:
        """Take in an image in which the target was found by its edges."""
        if time < self._due or pose.source != "edges":
            return
        self._due = time + SELFCAL.period
        evidence = self._maker.look(pixels, pose)
        if evidence is not None:
            self._filter.image_seen(time, evidence, enu_from_flu)

    def scale_words(self) -> Iterator[str]:
        """What contradicts a size or the focal length, each with both numbers."""
        k = self._camera.intrinsics
        share, sd = self._known(LENS_AT)
        sd = hypot(sd, FLOOR_RANGE)
        certain = SELFCAL.settled_certain if sd <= SELFCAL.settled else LIMITS.certainty.deviations
        if abs(share) > max(SELFCAL.share, certain * sd):
            yield (
                f"focal length {k.fx:.1f} px in the camera file, {k.fx * exp(share):.1f} +- {k.fx * sd:.1f} px by"
                " the images: calibrate again"
            )
        name, largest = self.target.name, self.target.tags[0]
        sizes = [(n, tag, f"against tag {largest.tag_id}") for n, tag in self._sized_tags()]
        if self._maker.is_spread:
            sizes.append((SIZES_AT + self._maker.sizes, largest, "against the distances between tags"))
        for n, tag, against in sizes:
            share, sd = self._known(n)
            if self._tells(n, SELFCAL.share):
                mm = 1000 * tag.size
                better = f"{mm * exp(share):.1f} +- {mm * sd:.1f} mm {against}"
                yield f"tag {tag.tag_id} of {name}: {mm:.1f} mm in its file, {better}: measure the print"
        if self.heights.contradicts:
            way, (share, sd) = self.heights.covered, self.heights.scale
            yield (
                f"a way of {way * (1 - share):.2f} +- {way * sd:.2f} m by the barometer is {way:.2f} m by the eyes"
                f" over {name}: measure the print, check the focal length"
            )

    def lens_words(self) -> Iterator[str]:
        """What contradicts principal point or distortion."""
        k = self._camera.intrinsics
        for n, name, unit, digits, least in (
            (LENS_AT + 1, "cx", " px", 1, SELFCAL.centre_px),
            (LENS_AT + 2, "cy", " px", 1, SELFCAL.centre_px),
            (LENS_AT + 3, "k1", "", 3, SELFCAL.k1),
        ):
            off, sd = self._known(n)
            if self._tells(n, least):
                believed = getattr(k, name)
                better = f"{believed + off:.{digits}f} +- {sd:.{digits}f}{unit}"
                yield f"{name} {believed:.{digits}f}{unit} in the camera file, {better} by the images"

    def mounting_words(self) -> Iterator[str]:
        """What contradicts the mounting."""
        turns = zip(("roll", "pitch", "yaw"), np.degrees(self._filter.mean), np.degrees(self._filter.sd), strict=False)
        found = [
            f"{word} {turn:+.1f} +- {sd:.1f} deg"
            for n, (word, turn, sd) in enumerate(turns)
            if self._tells(n, SELFCAL.mounting)
        ]
        if found:
            report = self.report()
            believed, better = (
                ", ".join(f"{angle:.1f}" for angle in angles)
                for angles in (report.mount_believed_deg, report.mount_rpy_deg)
            )
            yield f"mount.rpy_deg is {believed}, the flight says {better} ({', '.join(found)})"

    def report(self) -> SelfCalibration:
        """All estimates."""
        mean, sd = self._filter.mean, self._filter.sd
        (focal, cx, cy, k1), (focal_sd, cx_sd, cy_sd, k1_sd) = (
            figures[LENS_AT:SIZES_AT].tolist() for figures in (mean, sd)
        )
        known = np.where(sd[MOUNTING] < SELFCAL.mounting, mean[MOUNTING], 0.0)
        height, height_sd = self.heights.scale
        return SelfCalibration(
            target=self.target.name,
            looks=self._filter.looks,
            mounting_deg=_three(np.degrees(mean[MOUNTING])),
            mounting_sd_deg=_three(np.degrees(sd[MOUNTING])),
            mount_believed_deg=self._camera.mount.rpy_deg,
            mount_rpy_deg=turned_rpy_deg(self._camera.mount, known),
            focal_percent=100.0 * focal,
            focal_sd_percent=100.0 * focal_sd,
            centre_px=(cx, cy),
            centre_sd_px=(cx_sd, cy_sd),
            k1=k1,
            k1_sd=k1_sd,
            sizes=tuple(
                TagSizeError(
                    tag_id=tag.tag_id, size_percent=100.0 * float(mean[n]), size_sd_percent=100.0 * float(sd[n])
                )
                for n, tag in self._sized_tags()
            ),
            height_percent=100.0 * height,
            height_sd_percent=100.0 * height_sd,
            height_covered=self.heights.covered,
            height_odds=self.heights.odds,
        )

    def _sized_tags(self) -> Iterator[tuple[int, Tag]]:
        """Tags whose size is an unknown, and where it stands."""
        return enumerate(self.target.tags[1 : 1 + self._maker.sizes], start=SIZES_AT)

    def _known(self, n: int) -> tuple[float, float]:
        """An unknown and its deviation."""
        return float(self._filter.mean[n]), float(self._filter.sd[n])

    def _tells(self, n: int, least: float) -> bool:
        """Whether a difference is told: more than what is nobody's fault, and no accident."""
        value, sd = self._known(n)
        return abs(value) > hypot(least, LIMITS.certainty.deviations * sd)


class SelfCheck:
    """Watches one camera; without a camera file there is nothing to watch.

    Args:
        tagmap: its targets.
        camera: its file, with the mount believed.
        has_mount: whether anybody said how it sits.
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].

    Attributes:
        alarms: what contradicts the camera file or a target file, with both numbers.
    """

    def __init__(self, tagmap: TagMap, camera: Camera | None, attitude_sd: float, *, has_mount: bool) -> None:
        self._camera = camera
        self._watches = {
            target.name: TargetWatch(target, camera, attitude_sd, has_mount=has_mount)
            for target in tagmap.targets
            if camera is not None
        }
        self.alarms: dict[Alarm, str] = {}

    def image_seen(
        self,
        pixels: Grey,
        poses: Mapping[str, Pose],
        heights: Mapping[str, float],
        time: float,
        enu_from_flu: Array | None,
    ) -> None:
        """Take in an image `(h, w)` uint8, the middle of its exposure [s], and the attitude `(3, 3)` then, if known.

        Poses of targets, and the heights of the vehicle over them [m], are by name.
        """
        for name, pose in poses.items():
            watch = self._watches[name]
            watch.image_seen(pixels, pose, time, enu_from_flu)
            if not watch.target.moving and watch.target.level:
                watch.heights.pose_seen(time, heights[name])
        self.alarms = dict(self._judge())

    def barometer_received(self, time: float, height: float) -> None:
        """Take the barometer's height [m] at a time [s]."""
        for watch in self._watches.values():
            watch.heights.reading_received(time, height)

    def reports(self) -> tuple[SelfCalibration, ...]:
        """All estimates, of every target that was seen."""
        return tuple(found for watch in self._watches.values() if (found := watch.report()).looks)

    def _judge(self) -> Iterator[tuple[Alarm, str]]:
        watches = self._watches.values()
        scale = [*self._sheet_words(), *(words for watch in watches for words in watch.scale_words())]
        lens = [words for watch in watches for words in watch.lens_words()]
        mounting = [words for watch in watches for words in watch.mounting_words()]
        if scale:
            yield Alarm.SCALE, "; ".join(scale)
        if lens:
            yield Alarm.LENS, f"{'; '.join(lens)}: calibrate again"
        if mounting:
            yield Alarm.MOUNTING, f"{mounting[0]}: look at the camera's seat, then mkdaemon calibrate mount"

    def _sheet_words(self) -> Iterator[str]:
        if self._camera is None:
            return
        record, focal = self._camera.calibration, self._camera.intrinsics.fx
        if record.sheet_focal_mm > 0.0 and record.sheet_pixel_um > 0.0:
            expected = 1000.0 * record.sheet_focal_mm / record.sheet_pixel_um
            if abs(focal / expected - 1.0) > SELFCAL.sheet:
                yield f"focal length {focal:.0f} px in the camera file, {expected:.0f} px by the data sheet"


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z

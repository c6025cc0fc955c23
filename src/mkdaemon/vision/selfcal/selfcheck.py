"""Watches one camera fly: whether images, attitude and barometer agree with its camera file and its target files.

Images: with d the offsets of the edges from where a pose puts them and J their derivative, J x = d. The unknowns x are
those of one image alone, its pose and a common shift, which are forgotten with it, and those that all images share: of
lens, sizes, and the bend of the print. Source: bundle adjustment, Triggs et al., Vision Algorithms, LNCS 1883, 2000.

Attitude: with n the normal that an image shows, off by a turn x of its pose, M the mounting and E the attitude, the
horizontal part of the normal in the world is y = E M n. Were the mounting turned by m, the deck d and the scale k, it
would be y = d - E (m x M n) - E M (x x n) + k E e_z. A mounting turns with the vehicle, a deck does not: without yaw
only their sum is seen, and the deviations say so.

Barometer: with z the height by vision, e the share of it that is too much, b the barometer, a its offset and L its
delay, b = a + z - e z - L dz/dt. Nothing else tells sizes that are all wrong by one factor.

What each of them tells, and how well: docs/lab/vision-cases.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from math import exp, hypot, inf, log, radians
from typing import Final

import numpy as np

from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.telemetry.selfcal import HEIGHTS_LIKELY, SelfCalibration, TagSizeError
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.calibration_file import Camera, mount_rotation
from mkdaemon.vision.limits import LIMITS, SELFCAL
from mkdaemon.vision.pose.edgefit import EdgeFit, EdgeStep, shifts
from mkdaemon.vision.pose.pose import FLOOR_RANGE, Pose, turn
from mkdaemon.vision.pose.prints import sheet_of
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.pose.unknowns import POSE, UnknownRow, Unknowns
from mkdaemon.vision.tags.tagmap import TagMap, Target

ALIGNED_PX: Final = 0.08
"""Error that the edges of a tag's side share where it runs along a row of pixels [px]; less by the rows it crosses.
Measured: errors over deviations, docs/lab/accuracy.md."""
SHIFTED: Final = 0.15
"""The same for each pixel all edges are shifted by: a tone curve or sharpening bends them too."""
ROLLING_PX: Final = 0.3
"""The same under a rolling shutter, whose motion is part of the error [px]."""
APART: Final = 0.5
"""Distance between centres from which tags are beside each other, sides of the largest one."""
MOST_SIZES: Final = 8
"""Targets of more tags share one unknown size."""
MELTS: Final = 5
"""Power of their side by which small cells look smaller. Measured: docs/lab/vision-cases.md."""
ALIKE_TIME: Final = 0.2
"""Time within which errors of the attitude are one error [s]."""
UNKNOWNS: Final = {
    "roll": (radians(5.0), radians(0.02), SELFCAL.mounting),
    "pitch": (radians(5.0), radians(0.02), SELFCAL.mounting),
    "yaw": (radians(5.0), radians(0.02), SELFCAL.mounting),
    "deck_east": (radians(2.5), radians(0.02), inf),
    "deck_north": (radians(2.5), radians(0.02), inf),
    "tilt_scale": (0.08, 0.0, inf),
    "focal": (0.03, 0.0, LIMITS.certainty.wrong_share),
    "cx": (10.0, 0.0, SELFCAL.centre_px),
    "cy": (10.0, 0.0, SELFCAL.centre_px),
    "k1": (0.05, 0.0, SELFCAL.k1),
}
"""Of each its deviation before any image, its random walk in a second, and what of it is unavoidable.

Turn of the mounting about body forward, left, up [rad], which wanders with the attitude's bias, 0.2 degrees in 100 s;
horizontal part of the target's normal, as `PRIOR_SD` of `track.level`; share by which the vehicle reports too much
tilt, 0.89 to 1.13 with real gyros; logarithm of the focal lengths; principal point [px]; radial distortion."""
SIZE: Final = (0.03, 0.0, LIMITS.certainty.wrong_share)
"""The same of a tag's size, logarithm."""
MELT: Final = (0.008, 0.0, inf)
"""By how much a tag of the smallest readable cells may look smaller or larger, logarithm; one error of all images."""
MOVING_DECK: Final = radians(2.0)
"""Random walk of the normal of a target that moves [rad/sqrt(s)]."""
MOUNTING, DECK, TILT_SCALE, LENS_AT, SIZES_AT = slice(0, 3), slice(3, 5), 5, 6, len(UNKNOWNS)
TURN: Final = slice(3, 6)
"""Where the turn of the pose is among the unknowns of an image."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageEvidence:
    """Information of one image about its own unknowns, then those of `CameraFilter`; cost x^T matrix x - 2 pull^T x.

    Attributes:
        rotation: camera from target as the pose has it `(3, 3)`.
        matrix: information `(k, k)`.
        pull: information times unknowns `(k,)`.
    """

    rotation: Array
    matrix: Array
    pull: Array


class Belief:
    """A normal distribution of unknowns: `mean` `(n,)`, `covariance` `(n, n)`, `walk` `(n,)` at random [1/sqrt(s)]."""

    def __init__(self, mean: Array, covariance: Array, walk: Array) -> None:
        self.mean, self.covariance, self._walk = mean, covariance, walk
        self._time: float | None = None

    @property
    def sd(self) -> Array:
        """Standard deviations `(n,)`."""
        deviations: Array = np.sqrt(np.diag(self.covariance))
        return deviations

    def wait(self, time: float) -> float:
        """Let the unknowns wander up to a time [s]; how long that was [s]."""
        spent = 0.0 if self._time is None else max(time - self._time, 0.0)
        self._time = time
        self.covariance = self.covariance + spent * np.diag(self._walk**2)
        return spent

    def learn(self, matrix: Array, pull: Array) -> None:
        """Add information `(k, k)`: unknowns x cost x^T matrix x - 2 pull^T x, and these are the last ones of x."""
        own = len(pull) - len(self.mean)
        before = np.linalg.inv(self.covariance)
        after = np.linalg.inv(np.pad(before, (own, 0)) + matrix)
        self.mean = (after @ (np.pad(before @ self.mean, (own, 0)) + pull))[own:]
        self.covariance = (after + after.T)[own:, own:] / 2


class CameraFilter(Belief):
    """Filter of the constant unknowns of one camera and one target.

    The unknowns: `UNKNOWNS`; the logarithm of each unknown size, and of what melting makes of small cells; the bend of
    a print that bends.

    Args:
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].
        flu_from_cam: the mounting believed `(3, 3)`; none says nothing about attitude.

    Attributes:
        sized: tags of an unknown size, and against what; the first tag, last, where distances tell how large all are.
        least: of each unknown but the bend, the unavoidable part.
        looks: images taken in.
    """

    def __init__(self, target: Target, projection: Projection, attitude_sd: float, flu_from_cam: Array | None) -> None:
        self._projection, self._attitude_sd, self._flu_from_cam = projection, attitude_sd, flu_from_cam
        self._fit = EdgeFit(target, projection)
        model = self._fit.model
        centres = np.array([tag.position for tag in target.tags])
        self._from_centre = model.points - centres[model.tag]
        self._size = np.array([tag.size for tag in target.tags])[model.tag]
        largest, *others = target.tags
        self.sized = [(tag, f"against tag {largest.tag_id}") for tag in others if len(others) < MOST_SIZES]
        self._grow = model.tag == np.arange(1, len(self.sized) + 1)[:, None]
        if np.linalg.norm(centres - centres[0], axis=1).max() > APART * largest.size:
            self.sized.append((largest, "against the distances between tags"))
            self._grow = np.pad(self._grow, ((0, 1), (0, 0)), constant_values=True)
        self.looks = 0
        sheet = sheet_of(target)
        sd, walk, self.least = np.array([*UNKNOWNS.values(), *[SIZE] * len(self.sized), MELT]).T
        if target.moving:
            walk[DECK] = MOVING_DECK
        bend = np.empty((0, 0)) if sheet is None else sheet.prior.covariance
        covariance = np.pad(np.diag(sd**2), (0, len(bend)))
        covariance[len(sd) :, len(sd) :] = bend
        super().__init__(np.zeros(len(covariance)), covariance, np.pad(walk, (0, len(bend))))

    def look(self, pixels: Grey, pose: Pose) -> ImageEvidence | None:
        """Ask an image `(h, w)` uint8 about a pose found in it; none when too few edges are seen."""
        located = self._fit.locate(pixels, pose)
        if located is None:
            return None
        samples, edges, unknowns = located
        index, rows, normals, model = samples.index, unknowns.rows, samples.normals, self._fit.model
        seen = model.points[index] @ pose.rotation.T + pose.position
        # What moves an edge along its normal n: a focal length longer by e, e n . (u - c); a centre beside its place
        # by d, n . d; k1, by its derivative; a tag larger by e, e times its arm from the tag's centre.
        along = (samples.pixels - self._projection.centre) * normals
        bent = self._projection.k1_jacobian(seen) * normals
        px_per_m = float(self._projection.focal[0] / pose.position[2])
        grown = (rows[:3].T * (self._from_centre[index] @ pose.rotation.T)).sum(axis=1)
        melts = (LIMITS.cells.readable_px / (model.cell[index] * px_per_m)) ** MELTS
        rise = rows[unknowns["rise"]] if "rise" in unknowns else rows[:0]
        if pose.bend is not None:
            # The pose knows how its print bends in this image; here all images say so together.
            edges = replace(edges, offsets=edges.offsets + pose.bend.mean @ rise)
        every = Unknowns(
            [
                UnknownRow("pose", rows[POSE]),
                shifts(edges.toned, model.smaller[:, index]),
                UnknownRow("attitude", np.zeros((LENS_AT, len(index)))),
                UnknownRow("lens", np.stack([along.sum(axis=1), *normals.T, bent.sum(axis=1)])),
                UnknownRow("sizes", grown * np.vstack([self._grow[:, index], melts])),
                UnknownRow("rise", rise),
            ]
        )
        step = EdgeStep(every, samples, edges, 0.0)
        # No residual shows what edges share.
        crossed = np.abs(normals).min(axis=1) * self._size[index] * px_per_m
        shared = ALIGNED_PX**2 / (1.0 + crossed**2) + (SHIFTED * pose.shift_px) ** 2
        if self._projection.shutter.rolls:
            shared += ROLLING_PX**2
        weights = step.weights / (step.variance + shared)
        return ImageEvidence(pose.rotation, *every.equations(weights, edges.offsets, 1.0))

    def image_seen(self, time: float, evidence: ImageEvidence, enu_from_flu: Array | None) -> None:
        """Take in what an image says, the middle of its exposure [s], and the attitude `(3, 3)` then, if known."""
        spent = self.wait(time)
        self.looks += 1
        matrix, pull = evidence.matrix, evidence.pull
        if enu_from_flu is not None and self._flu_from_cam is not None:
            enu_from_cam, normal_cam = enu_from_flu @ self._flu_from_cam, evidence.rotation[:, 2]
            by = np.zeros((2, len(pull)))
            shared = by[:, -len(self.mean) :]
            # a small turn w moves the normal n by w x n = -[n]x w
            by[:, TURN] = (enu_from_cam @ skew(normal_cam))[:2]
            shared[:, MOUNTING] = (enu_from_flu @ skew(self._flu_from_cam @ normal_cam))[:2]
            shared[:, DECK] = np.eye(2)
            shared[:, TILT_SCALE] = enu_from_flu[:2, 2]
            weighted = by.T * min(spent / ALIKE_TIME, 1.0) / self._attitude_sd**2
            matrix, pull = matrix + weighted @ by, pull + weighted @ (enu_from_cam @ normal_cam)[:2]
        self.learn(matrix, pull)


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
"""A working barometer changes by this on a climb or descent [m]: two of its steps, or one of the coarse ones."""
LONGEST_GAP: Final = 0.5
"""Between two poses that a reading lies between [s]."""
PAUSE: Final = 5.0
"""Time without both after which the offset is unknown again [s]."""
KEPT: Final = 50
"""Readings that wait for the next pose."""


class HeightFilter(Belief):
    """Heights over one target and the barometer's: their offset [m], the share that is too much, the delay [s]."""

    def __init__(self) -> None:
        sd, walk = np.array([OFFSET_SD, SCALE_SD, DELAY[1]]), np.array([WANDER, 0.0, 0.0])
        super().__init__(np.array([0.0, 0.0, DELAY[0]]), np.diag(sd**2), walk)
        self._waiting: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: tuple[float, float] | None = None
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    @property
    def scale(self) -> tuple[float, float]:
        """Share by which vision's heights are too large, and its deviation."""
        return float(self.mean[1]), float(self.sd[1])

    @property
    def odds(self) -> float:
        """Decimal logarithm of a Bayes factor: the share is anything, or what a calibration and a measured print leave.

        Readings alone, without the belief before them, have a mean and a variance; under a hypothesis that mean has
        both variances. 0 where nothing is known; a barometer that does not move is dead.
        """
        # Readings alone: 1 / v = 1 / sd^2 - 1 / SCALE_SD^2, m = share / (sd^2 / v). Then m is N(0, v + s^2) with s of
        # either hypothesis, and ln K = (m^2 (1 / right - 1 / wrong) - ln(wrong / right)) / 2.
        # Source: H. Jeffreys, Theory of Probability, 1961, chapter 5.
        share, sd = self.scale
        left = 1.0 / sd**2 - 1.0 / SCALE_SD**2
        if self._high[1] - self._low[1] < LEAST_CHANGE or left <= 0.0:
            return 0.0
        mean, variance = share / (sd**2 * left), 1.0 / left
        wrong, right = variance + SCALE_SD**2, variance + 2 * LIMITS.certainty.wrong_share**2
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
        self._waiting.append((time, height))

    def pose_seen(self, time: float, height: float) -> None:
        """Take vision's height over the target [m] at a time [s]."""
        before, self._last = self._last, (time, height)
        if before is None or not 0.0 < time - before[0] < LONGEST_GAP:
            return
        speed = (height - before[1]) / (time - before[0])
        while self._waiting and self._waiting[0][0] < time:
            at, barometer = self._waiting.popleft()
            here = before[1] + speed * (at - before[0])
            if at < before[0] or here <= LOWEST:
                continue
            if self.wait(at) > PAUSE:
                self.covariance[0, 0] += OFFSET_SD**2
            # barometer(t) = offset + h(t - delay), and vision shows (1 + share) h, so to first order
            # barometer - here = offset - share here - delay speed: a row (1, -here, -speed) of the information filter.
            both, by = (here, barometer), np.array([1.0, -here, -speed])
            self._low, self._high = np.minimum(self._low, both), np.maximum(self._high, both)
            self.learn(np.outer(by, by) / READING_SD**2, by * (barometer - here) / READING_SD**2)


class TargetWatch:
    """Self-calibration of a camera by one target; see `SelfCheck`."""

    def __init__(self, target: Target, camera: Camera, attitude_sd: float) -> None:
        self.target = target
        self._camera = camera
        flu_from_cam = mount_rotation(camera.mount) if target.level else None
        self._filter = CameraFilter(target, Projection(camera.intrinsics), attitude_sd, flu_from_cam)
        self.heights = HeightFilter()
        self._due = -np.inf

    def image_seen(self, pixels: Grey, pose: Pose, height: float, time: float, enu_from_flu: Array | None) -> None:
        """Take in an image in which the target was found, and the vehicle's height over it [m]."""
        if self.target.level and not self.target.moving:
            self.heights.pose_seen(time, height)
        if time < self._due or pose.source != "edges":
            return
        self._due = time + SELFCAL.period
        evidence = self._filter.look(pixels, pose)
        if evidence is not None:
            self._filter.image_seen(time, evidence, enu_from_flu)

    def contradictions(self) -> Iterator[tuple[Alarm, str]]:
        """Contradictions to the camera file or the target file, each with both numbers."""
        k, name = self._camera.intrinsics, self.target.name
        scales = [(LENS_AT, "focal length", k.fx, "px in the camera file", "px by the images: calibrate again")]
        for n, (tag, against) in enumerate(self._filter.sized, SIZES_AT):
            after = f"mm {against}: measure the print"
            scales.append((n, f"tag {tag.tag_id} of {name}:", 1000 * tag.size, "mm in its file", after))
        for n, what, believed, before, after in scales:
            if self._tells(n):
                share, sd = self._known(n)
                better = f"{believed * exp(share):.1f} +- {believed * sd:.1f}"
                yield Alarm.SCALE, f"{what} {believed:.1f} {before}, {better} {after}"
        if self.heights.contradicts:
            way, (share, sd) = self.heights.covered, self.heights.scale
            words = f"a way of {way * (1 - share):.2f} +- {way * sd:.2f} m by the barometer is {way:.2f} m by vision"
            yield Alarm.SCALE, f"{words} over {name}: measure the print, check the focal length"
        for n, (field, unit, digits) in enumerate((("cx", " px", 1), ("cy", " px", 1), ("k1", "", 3)), LENS_AT + 1):
            if self._tells(n):
                believed, (off, sd) = getattr(k, field), self._known(n)
                better = f"{believed + off:.{digits}f} +- {sd:.{digits}f}{unit} by the images: calibrate again"
                yield Alarm.LENS, f"{field} {believed:.{digits}f}{unit} in the camera file, {better}"
        turned = [
            "{} {:+.1f} +- {:.1f} deg".format(word, *np.degrees(self._known(n)))
            for n, word in enumerate(("roll", "pitch", "yaw"))
            if self._tells(n)
        ]
        if turned:
            report = self.report()
            before, after = (
                ", ".join(f"{angle:.1f}" for angle in angles)
                for angles in (report.mount_believed_deg, report.mount_rpy_deg)
            )
            words = f"mount.rpy_deg is {before}, the flight says {after} ({', '.join(turned)})"
            yield Alarm.MOUNTING, f"{words}: look at the camera's seat, then mkdaemon calibrate mount"

    def report(self) -> SelfCalibration:
        """All estimates."""
        mean, sd = self._filter.mean.tolist(), self._filter.sd.tolist()
        (focal, cx, cy, k1), (focal_sd, cx_sd, cy_sd, k1_sd) = mean[LENS_AT:SIZES_AT], sd[LENS_AT:SIZES_AT]
        known = np.where(np.less(sd[MOUNTING], SELFCAL.mounting), mean[MOUNTING], 0.0)
        turned = turn(rotation_from_euler(*np.radians(self._camera.mount.rpy_deg)), known)
        height, height_sd = self.heights.scale
        return SelfCalibration(
            target=self.target.name,
            looks=self._filter.looks,
            mounting_deg=tuple(np.degrees(mean[MOUNTING]).tolist()),
            mounting_sd_deg=tuple(np.degrees(sd[MOUNTING]).tolist()),
            mount_believed_deg=self._camera.mount.rpy_deg,
            mount_rpy_deg=tuple(np.degrees(euler_from_rotation(turned)).tolist()),
            focal_percent=100.0 * focal,
            focal_sd_percent=100.0 * focal_sd,
            centre_px=(cx, cy),
            centre_sd_px=(cx_sd, cy_sd),
            k1=k1,
            k1_sd=k1_sd,
            sizes=tuple(
                TagSizeError(tag_id=tag.tag_id, size_percent=100.0 * mean[n], size_sd_percent=100.0 * sd[n])
                for n, (tag, _) in enumerate(self._filter.sized, SIZES_AT)
                if tag is not self.target.tags[0]
            ),
            height_percent=100.0 * height,
            height_sd_percent=100.0 * height_sd,
            height_covered=self.heights.covered,
            height_odds=self.heights.odds,
        )

    def _known(self, n: int) -> tuple[float, float]:
        """An unknown and its deviation, of a focal length with what no image shows."""
        return float(self._filter.mean[n]), hypot(float(self._filter.sd[n]), FLOOR_RANGE * (n == LENS_AT))

    def _tells(self, n: int) -> bool:
        """Whether a difference is reported: more than the unavoidable part, and significant."""
        (value, sd), least = self._known(n), float(self._filter.least[n])
        if n == LENS_AT:
            certain = SELFCAL.settled_certain if sd <= SELFCAL.settled else LIMITS.certainty.deviations
            return abs(value) > max(least, certain * sd)
        return abs(value) > hypot(least, LIMITS.certainty.deviations * sd)


class SelfCheck:
    """Watches one camera by its targets that are no maps; without a camera file there is nothing to watch.

    Args:
        camera: its file, with the mount believed.
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].

    Attributes:
        alarms: what contradicts the camera file or a target file, with both numbers.
    """

    def __init__(self, tagmap: TagMap, camera: Camera | None, attitude_sd: float) -> None:
        self._watches = {
            target.name: TargetWatch(target, camera, attitude_sd)
            for target in tagmap.targets
            if camera is not None and not target.is_map
        }
        self._by_sheet = [] if camera is None else list(_sheet_contradictions(camera))
        self.alarms: dict[Alarm, str] = {}

    def image_seen(
        self, pixels: Grey, seen: Mapping[str, tuple[Pose, float]], time: float, enu_from_flu: Array | None
    ) -> None:
        """Take in an image `(h, w)` uint8, the middle of its exposure [s], and the attitude `(3, 3)` then, if known.

        Seen are poses of targets by name, each with the height of the vehicle over it [m].
        """
        for name, (pose, height) in seen.items():
            if name in self._watches:
                self._watches[name].image_seen(pixels, pose, height, time, enu_from_flu)
        found: dict[Alarm, list[str]] = {}
        for alarm, words in chain(self._by_sheet, *(watch.contradictions() for watch in self._watches.values())):
            found.setdefault(alarm, []).append(words)
        self.alarms = {alarm: "; ".join(words) for alarm, words in found.items()}

    def barometer_received(self, time: float, height: float) -> None:
        """Take the barometer's height [m] at a time [s]."""
        for watch in self._watches.values():
            watch.heights.reading_received(time, height)

    def reports(self) -> tuple[SelfCalibration, ...]:
        """All estimates, of every target that was seen."""
        return tuple(found for watch in self._watches.values() if (found := watch.report()).looks)


def _sheet_contradictions(camera: Camera) -> Iterator[tuple[Alarm, str]]:
    """Whether the data sheets of lens and sensor, where the camera file has them, contradict its focal length."""
    record, focal = camera.calibration, camera.intrinsics.fx
    if record.sheet_focal_mm > 0.0 and record.sheet_pixel_um > 0.0:
        expected = 1000.0 * record.sheet_focal_mm / record.sheet_pixel_um
        if abs(focal / expected - 1.0) > SELFCAL.sheet:
            yield Alarm.SCALE, f"focal length {focal:.0f} px in the camera file, {expected:.0f} px by the data sheet"

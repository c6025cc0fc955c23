"""Watches one camera fly: whether images, attitude and barometer agree with its camera file and its target files.

Images: with d the offsets of the edges from where a pose puts them, J their derivative by that pose and by a common
shift, and C their derivative by what else may be wrong, d = J x + C p. The pose that the image alone asks for is
x(p) = x0 - X p with X = (J^T W J)^-1 J^T W C, and what is left says about p as much as the information
A = C^T W C - C^T W J X. Source: the Schur complement of a bundle adjustment, Triggs et al., Vision Algorithms, LNCS
1883, 2000, section 6.

Attitude: with n the normal that an image shows, in body axes, and E the attitude, the horizontal part of the normal in
the world is y = E n. Were the mounting turned by m, the lens or a size changed by p, the deck d and the scale k, it
would be y = d - E (m x n) - E M (T p x n_cam) + k E e_z, with T the turn of a pose with lens and sizes. A mounting
turns with the vehicle, a deck does not: without yaw only their sum is seen, and the deviations say so.

Barometer: with z the height by the eyes, e the share of it that is too much, b the barometer, a its offset and L its
delay, b = a + z - e z - L dz/dt. The offset wanders, so slow flights say little, and a hover nothing. A print whose
sizes are all wrong by one factor looks like one that is farther away, from every range: only this tells it.
What each of them tells, and how well: docs/lab/vision-cases.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import exp, hypot, log
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.telemetry.selfcal import HEIGHTS_LIKELY, SelfCalibration, TagSizeError
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.calibration_file import Camera, mount_rotation
from mkdaemon.vision.limits import LIMITS, SELFCAL
from mkdaemon.vision.pose.bend import Bend
from mkdaemon.vision.pose.edgefit import EdgeFit, EdgeStep, shifts
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.pose import FLOOR_RANGE, Pose, damped, turn
from mkdaemon.vision.pose.prints import sheet_of
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.pose.unknowns import POSE, Unknown, Unknowns
from mkdaemon.vision.tags.tagmap import TagMap, Target

LENS: Final = ("focal", "cx", "cy", "k1")
"""What may be wrong with a lens: logarithm of the focal lengths, principal point [px], radial distortion."""
ALIGNED_PX: Final = 0.08
"""Error that the edges of a tag's side share where it runs along a row of pixels [px]: all lie between the same two. It
falls with the rows that a side crosses. Measured: errors over deviations, docs/lab/accuracy.md."""
SHIFTED: Final = 0.15
"""The same for each pixel all edges are shifted by: a tone curve or sharpening bends them too."""
ROLLING_PX: Final = 0.3
"""The same under a rolling shutter, whose motion is part of the error [px]."""
APART: Final = 0.5
"""Distance between centres from which tags are beside each other, sides of the largest one."""
MOST_SIZES: Final = 8
"""Targets of more tags share one unknown size."""
SHIFT_SD_PX: Final = 0.5
"""How far all edges may be shifted together [px]."""
MELTS: Final = 5
"""Small cells look smaller by a share that falls with this power of their side: neighbours pull their edges. Measured:
docs/lab/vision-cases.md."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageEvidence:
    """One image's say about unknowns `(k,)`: the lens in the order of `LENS`, sizes, melting, the rise of a bent print.

    Attributes:
        rotation: camera from target by the image alone, lens and sizes as believed `(3, 3)`.
        covariance: of that rotation `(3, 3)` [rad^2; camera].
        turn: how the rotation turns with the unknowns `(3, k)` [rad].
        matrix: information about the unknowns whatever the pose `(k, k)`; the cost is p^T matrix p - 2 pull^T p.
        pull: see `matrix` `(k,)`.
    """

    rotation: Array
    covariance: Array
    turn: Array
    matrix: Array
    pull: Array


class EvidenceMaker:
    """Asks images of one target.

    Attributes:
        sized: tags of an unknown size each, its logarithm, and against what. Where distances between tags say how large
            they all are, that is the size of tag 0, the last one.
        bend: of its one print, which is three more unknowns; none for several prints, or a rigid one.
    """

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        self._fit = EdgeFit(target, projection)
        model = self._fit.model
        centres = np.array([tag.position for tag in target.tags])
        self._from_centre = model.points - centres[model.tag]
        self._size = np.array([tag.size for tag in target.tags])[model.tag]
        largest, *others = target.tags
        self.sized = [(tag, f"against tag {largest.tag_id}") for tag in others if len(others) < MOST_SIZES]
        self._grow = model.tag[:, None] == np.arange(1, len(self.sized) + 1)
        if np.linalg.norm(centres - centres[0], axis=1).max() > APART * largest.size:
            self.sized.append((largest, "against the distances between tags"))
            self._grow = np.pad(self._grow, ((0, 0), (0, 1)), constant_values=True)
        sheet = sheet_of(target)
        self.bend = None if sheet is None else sheet.prior

    def look(self, pixels: Grey, pose: Pose) -> ImageEvidence | None:
        """Ask an image `(h, w)` uint8 about a pose found in it; none when too few edges are seen."""
        located = self._fit.locate(pixels, pose)
        if located is None:
            return None
        samples, edges, unknowns = located
        index, jacobian, by_rise = samples.index, unknowns.rows[POSE].T, np.zeros((len(samples.index), 0))
        if "rise" in unknowns:
            by_rise = unknowns.rows[unknowns["rise"]].T
        shift = shifts(np.ones(len(index)), self._fit.model.smaller[index]).rows
        shifted = np.column_stack([jacobian, shift.T])
        columns = np.column_stack([self._by_lens(samples, pose), self._by_size(index, jacobian, pose), by_rise])
        # The pose knows how its print bends in this image; here all images say so together.
        offsets = edges.offsets if pose.bend is None else edges.offsets + by_rise @ pose.bend.mean
        crossed = np.abs(samples.normals).min(axis=1) * self._size[index] * self._px_per_m(pose)
        shared = ALIGNED_PX**2 / (1.0 + crossed**2) + (SHIFTED * pose.shift_px) ** 2
        if self._projection.shutter.rolls:
            shared += ROLLING_PX**2
        every = Unknowns([Unknown("every", np.column_stack([shifted, columns]).T)])
        step = EdgeStep(every, samples, replace(edges, offsets=offsets), 0.0)
        # No residual shows what edges share.
        weights = step.weights / (step.variance + shared)
        weighted = shifted * weights[:, None]
        shift_sd = np.array([*[LIMITS.edges.shift_sd_px] * (len(shift) - 1), SHIFT_SD_PX])
        normal = damped(weighted.T @ shifted + np.diag(np.pad(shift_sd**-2, (6, 0))))
        asked = np.column_stack([columns, offsets])
        both = weighted.T @ asked
        follows: Array = np.asarray(np.linalg.solve(normal, both), dtype=np.float64)
        left = (asked * weights[:, None]).T @ asked - both.T @ follows
        return ImageEvidence(
            turn(pose.rotation, follows[3:6, -1]),
            np.asarray(np.linalg.inv(normal)[3:6, 3:6], dtype=np.float64),
            -follows[3:6, :-1],
            (left + left.T)[:-1, :-1] / 2,
            left[:-1, -1],
        )

    def _by_lens(self, samples: Samples, pose: Pose) -> Array:
        """Derivative of the offsets by the lens `(n, 4)`."""
        seen = self._fit.model.points[samples.index] @ pose.rotation.T + pose.position
        along, normals = (samples.pixels - self._projection.centre) * samples.normals, samples.normals
        bent = self._projection.k1_jacobian(seen) * normals
        return np.column_stack([along.sum(axis=1), normals, bent.sum(axis=1)])

    def _by_size(self, index: npt.NDArray[np.intp], jacobian: Array, pose: Pose) -> Array:
        """Derivative of the offsets by the logarithms of the sizes, and by melting `(n, sizes + 1)`."""
        grown = (jacobian[:, :3] * (self._from_centre[index] @ pose.rotation.T)).sum(axis=1)
        cell_px = self._fit.model.cell[index] * self._px_per_m(pose)
        melts = (LIMITS.cells.readable_px / cell_px) ** MELTS
        columns: Array = grown[:, None] * np.column_stack([self._grow[index], melts])
        return columns

    def _px_per_m(self, pose: Pose) -> float:
        """Of the target in the image."""
        return float(self._projection.focal[0] / pose.position[2])


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
"""A longer time without news counts as so much [s]."""
SIZE_SD: Final = 0.03
"""How far a tag's size may be off, logarithm."""
MELT_SD: Final = 0.008
"""By how much a tag of the smallest readable cells may look smaller or larger, logarithm; one error of all images."""
MOUNTING: Final = slice(0, 3)
DECK: Final = slice(3, 5)
TILT_SCALE: Final = 5
LENS_AT: Final = 6
SIZES_AT: Final = LENS_AT + len(LENS)


class Belief:
    """A normal distribution of unknowns: `mean` `(n,)` and `covariance` `(n, n)`.

    They wander: `walk` is how far in a second, deviations of a random walk `(n,)` [1/sqrt(s)].
    """

    def __init__(self, mean: Array, covariance: Array, walk: Array) -> None:
        self.mean, self.covariance, self._walk = mean, covariance, walk
        self._time: float | None = None

    @property
    def sd(self) -> Array:
        """Standard deviations `(n,)`."""
        deviations: Array = np.sqrt(np.diag(self.covariance))
        return deviations

    def wait(self, time: float) -> float:
        """Let the unknowns wander up to a time [s], for `LONGEST` at most; how long that was [s]."""
        spent = 0.0 if self._time is None else min(max(time - self._time, 0.0), LONGEST)
        self._time = time
        self.covariance = self.covariance + spent * np.diag(self._walk**2)
        return spent

    def learn(self, matrix: Array, pull: Array) -> None:
        """Add information `(n, n)`: unknowns p cost p^T matrix p - 2 pull^T p."""
        before = np.linalg.inv(self.covariance)
        after = np.linalg.inv(before + matrix)
        self.mean, self.covariance = after @ (before @ self.mean + pull), (after + after.T) / 2

    def observe(self, value: Array, by: Array, noise: Array) -> None:
        """Learn from a value `(m,)` that is `by` `(m, n)` of the unknowns, with noise of a covariance `(m, m)`."""
        weighted = by.T @ np.linalg.inv(noise)
        self.learn(weighted @ by, weighted @ value)


class CameraFilter(Belief):
    """What is constant, or nearly so, about one camera and one target.

    The unknowns: the turn of the mounting about body forward, left, up [rad], the horizontal part of the target's
    normal, east and north, the share by which the vehicle reports too much tilt; then those of `ImageEvidence`.

    Args:
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].
        flu_from_cam: the mounting believed `(3, 3)`; none says nothing about attitude.
        is_moving: whether the target moves.
        sizes: how many unknown sizes the images speak of, melting apart.
        bend: what is known of that of its print; none where it does not bend.

    Attributes:
        looks: images taken in.
    """

    def __init__(
        self, attitude_sd: float, flu_from_cam: Array | None, *, is_moving: bool, sizes: int, bend: Bend | None = None
    ) -> None:
        sd = np.array([*[MOUNTING_SD] * 3, *[DECK_SD] * 2, TILT_SCALE_SD, *LENS_SD, *[SIZE_SD] * sizes, MELT_SD])
        rises = 0 if bend is None else len(bend.mean)
        walk = np.zeros(len(sd) + rises)
        walk[MOUNTING], walk[DECK] = MOUNTING_DRIFT, DECK_DRIFT[is_moving]
        super().__init__(np.zeros_like(walk), np.diag(np.pad(sd, (0, rises)) ** 2), walk)
        if bend is not None:
            self.mean[-rises:], self.covariance[-rises:, -rises:] = bend.mean, bend.covariance
        self._attitude_sd, self._flu_from_cam = attitude_sd, flu_from_cam
        self.looks = 0

    def image_seen(self, time: float, evidence: ImageEvidence, enu_from_flu: Array | None) -> None:
        """Take in what an image says, the middle of its exposure [s], and the attitude `(3, 3)` then, if known."""
        spent = self.wait(time)
        self.looks += 1
        apart = (LENS_AT, 0)
        self.learn(np.pad(evidence.matrix, (apart, apart)), np.pad(evidence.pull, apart))
        if enu_from_flu is None or self._flu_from_cam is None:
            return
        enu_from_cam, normal_cam = enu_from_flu @ self._flu_from_cam, evidence.rotation[:, 2]
        # a small turn w moves the normal n by w x n = -[n]x w
        away = (enu_from_cam @ skew(normal_cam))[:2]
        by = np.zeros((2, len(self.mean)))
        by[:, LENS_AT:] = away @ evidence.turn
        by[:, MOUNTING] = (enu_from_flu @ skew(self._flu_from_cam @ normal_cam))[:2]
        by[:, DECK] = np.eye(2)
        by[:, TILT_SCALE] = enu_from_flu[:2, 2]
        shared = max(ALIKE_TIME / max(spent, SOONEST), 1.0)
        noise = away @ evidence.covariance @ away.T + self._attitude_sd**2 * shared * np.eye(2)
        self.observe((enu_from_cam @ normal_cam)[:2], by, noise)


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


class HeightFilter(Belief):
    """Compares the heights over one target with those of the barometer.

    The unknowns: offset [m], share of the height that is too much, delay [s]. Two hypotheses about the share are
    compared: it is what a calibration and a measured print leave, or it is anything. Their odds are a Bayes factor.
    """

    def __init__(self) -> None:
        sd, walk = np.array([OFFSET_SD, SCALE_SD, DELAY[1]]), np.array([WANDER, 0.0, 0.0])
        super().__init__(np.array([0.0, 0.0, DELAY[0]]), np.diag(sd**2), walk)
        self._waiting: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: tuple[float, float] | None = None
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    @property
    def scale(self) -> tuple[float, float]:
        """Share by which the eyes' heights are too large, and its deviation."""
        return float(self.mean[1]), float(self.sd[1])

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
        self._waiting.append((time, height))

    def pose_seen(self, time: float, height: float) -> None:
        """Take the eyes' height over the target [m] at a time [s]."""
        before, self._last = self._last, (time, height)
        if before is None or not 0.0 < time - before[0] < LONGEST_GAP:
            return
        speed = (height - before[1]) / (time - before[0])
        while self._waiting and self._waiting[0][0] < time:
            at, barometer = self._waiting.popleft()
            here = before[1] + speed * (at - before[0])
            if at >= before[0] and here > LOWEST:
                self._compare(at, here, speed, barometer)

    def _compare(self, time: float, height: float, speed: float, barometer: float) -> None:
        if self.wait(time) > PAUSE:
            self.covariance[0, 0] += OFFSET_SD**2
        self._low, self._high = np.minimum(self._low, (height, barometer)), np.maximum(self._high, (height, barometer))
        by, noise = np.array([[1.0, -height, -speed]]), np.array([[READING_SD**2]])
        self.observe(np.array([barometer - height]), by, noise)


OFFSETS: Final = (
    ("cx", " px", 1, SELFCAL.centre_px),
    ("cy", " px", 1, SELFCAL.centre_px),
    ("k1", "", 3, SELFCAL.k1),
)
"""Figures of `LENS` that a sum corrects: unit, digits, and what is nobody's fault."""
ADVICE: Final = {
    Alarm.SCALE: "",
    Alarm.LENS: ": calibrate again",
    Alarm.MOUNTING: ": look at the camera's seat, then mkdaemon calibrate mount",
}


class TargetWatch:
    """What one target says about a camera; see `SelfCheck`."""

    def __init__(self, target: Target, camera: Camera, attitude_sd: float, *, has_mount: bool) -> None:
        self.target = target
        self._camera = camera
        self._maker = EvidenceMaker(target, Projection(camera.intrinsics))
        self._filter = CameraFilter(
            attitude_sd,
            mount_rotation(camera.mount) if has_mount and target.level else None,
            is_moving=target.moving,
            sizes=len(self._maker.sized),
            bend=self._maker.bend,
        )
        self.heights = HeightFilter()
        self._due = -np.inf

    def image_seen(self, pixels: Grey, pose: Pose, height: float, time: float, enu_from_flu: Array | None) -> None:
        """Take in an image in which the target was found, and the vehicle's height over it [m]."""
        if self.target.level and not self.target.moving:
            self.heights.pose_seen(time, height)
        if time < self._due or pose.source != "edges":
            return
        self._due = time + SELFCAL.period
        evidence = self._maker.look(pixels, pose)
        if evidence is not None:
            self._filter.image_seen(time, evidence, enu_from_flu)

    def contradictions(self) -> Iterator[tuple[Alarm, str]]:
        """What contradicts the camera file or the target file, each with both numbers."""
        k, name = self._camera.intrinsics, self.target.name
        record = self._camera.calibration
        if record.sheet_focal_mm > 0.0 and record.sheet_pixel_um > 0.0:
            expected = 1000.0 * record.sheet_focal_mm / record.sheet_pixel_um
            if abs(k.fx / expected - 1.0) > SELFCAL.sheet:
                yield Alarm.SCALE, f"focal length {k.fx:.0f} px in the camera file, {expected:.0f} px by the data sheet"
        share, sd = self._known(LENS_AT)
        certain = SELFCAL.settled_certain if sd <= SELFCAL.settled else LIMITS.certainty.deviations
        if abs(share) > max(SELFCAL.share, certain * sd):
            words = self._scaled(LENS_AT, k.fx, "px", "the camera file", "by the images")
            yield Alarm.SCALE, f"focal length {words}: calibrate again"
        for n, (tag, against) in enumerate(self._maker.sized, SIZES_AT):
            if self._tells(n, SELFCAL.share):
                words = self._scaled(n, 1000 * tag.size, "mm", "its file", against)
                yield Alarm.SCALE, f"tag {tag.tag_id} of {name}: {words}: measure the print"
        if self.heights.contradicts:
            way, (share, sd) = self.heights.covered, self.heights.scale
            words = f"a way of {way * (1 - share):.2f} +- {way * sd:.2f} m by the barometer is {way:.2f} m by the eyes"
            yield Alarm.SCALE, f"{words} over {name}: measure the print, check the focal length"
        for n, (field, unit, digits, least) in enumerate(OFFSETS, LENS_AT + 1):
            if self._tells(n, least):
                believed, (off, sd) = getattr(k, field), self._known(n)
                better = f"{believed + off:.{digits}f} +- {sd:.{digits}f}{unit} by the images"
                yield Alarm.LENS, f"{field} {believed:.{digits}f}{unit} in the camera file, {better}"
        turned = [
            "{} {:+.1f} +- {:.1f} deg".format(word, *np.degrees(self._known(n)))
            for n, word in enumerate(("roll", "pitch", "yaw"))
            if self._tells(n, SELFCAL.mounting)
        ]
        if turned:
            report = self.report()
            before, after = (
                ", ".join(f"{angle:.1f}" for angle in angles)
                for angles in (report.mount_believed_deg, report.mount_rpy_deg)
            )
            yield Alarm.MOUNTING, f"mount.rpy_deg is {before}, the flight says {after} ({', '.join(turned)})"

    def report(self) -> SelfCalibration:
        """All estimates."""
        mean, sd = self._filter.mean, self._filter.sd
        (focal, cx, cy, k1), (focal_sd, cx_sd, cy_sd, k1_sd) = (
            figures[LENS_AT:SIZES_AT].tolist() for figures in (mean, sd)
        )
        known = np.where(sd[MOUNTING] < SELFCAL.mounting, mean[MOUNTING], 0.0)
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
                TagSizeError(
                    tag_id=tag.tag_id, size_percent=100.0 * float(mean[n]), size_sd_percent=100.0 * float(sd[n])
                )
                for n, (tag, _) in enumerate(self._maker.sized, SIZES_AT)
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

    def _scaled(self, n: int, believed: float, unit: str, file: str, by: str) -> str:
        """A figure of a file, and what it is with the logarithm of a factor that is unknown `n`."""
        share, sd = self._known(n)
        better = f"{believed * exp(share):.1f} +- {believed * sd:.1f} {unit} {by}"
        return f"{believed:.1f} {unit} in {file}, {better}"

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
            self._watches[name].image_seen(pixels, pose, heights[name], time, enu_from_flu)
        found: dict[Alarm, dict[str, None]] = {}
        for watch in self._watches.values():
            for alarm, words in watch.contradictions():
                found.setdefault(alarm, {})[words] = None
        self.alarms = {alarm: "; ".join(words) + ADVICE[alarm] for alarm, words in found.items()}

    def barometer_received(self, time: float, height: float) -> None:
        """Take the barometer's height [m] at a time [s]."""
        for watch in self._watches.values():
            watch.heights.reading_received(time, height)

    def reports(self) -> tuple[SelfCalibration, ...]:
        """All estimates, of every target that was seen."""
        return tuple(found for watch in self._watches.values() if (found := watch.report()).looks)

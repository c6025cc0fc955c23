"""Following one target from image to image: prediction, fit, gates, re-detection, and restart."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import exp, hypot, isfinite
from typing import Final, Literal, NamedTuple

import cv2
import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.arrays import Array, Grey, UnknownsEstimate
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.ambiguity import prefers
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, inverse, moved, solve, with_floor
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import MOTIONS, Shutter, motion_of
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import TONES, Detector, Part
from mkdaemon.vision.tags.tagmap import Place, Tag, Target
from mkdaemon.vision.track.attitude import ImageSight, Mounting, Turning
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.judge import Decision, FitVerdict, Judge
from mkdaemon.vision.track.level import LevelKnowledge

FoundBy = Literal["predicted", "flow", "roi", "search"]
"""How a pose was found: where it is expected, where the target's image is found again, by tags near it or anywhere."""
LARGE_PX: Final = 160
"""Side of a window at half the resolution of which a target is found, 4 px a cell; larger ones are shrunk more."""
MOST_EFFORT: Final = 5
"""Spent on an image from which no other start is fitted, in fits to edges: one to grey values, and one to edges."""
SINCE: Final = 0.1
"""Deviation of a speed from that of the images before: 3 m/s^2 for 1/30 s [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetPose:
    """A published pose of one target.

    Attributes:
        target: name of the target.
        frame: its frame in `tf`.
        pose: camera from target, with the covariance of the measurement alone.
        ratio: residual of the mirrored candidate over this one; infinite without a rival.
        decided_by: what settled which candidate is true.
        mode: how it was found.
        decode_age: time since a tag of the target was last decoded [s].
        measured_at: middle of what was measured `(3,)` [m; target], from where calibration counts; None: its origin.
        is_of_map: the target is a map.
    """

    target: str
    frame: str
    pose: Pose
    ratio: float
    decided_by: Decision
    mode: FoundBy
    decode_age: float
    measured_at: Array | None = None
    is_of_map: bool = False

    @property
    def measured(self) -> Pose:
        """Pose of what was measured."""
        return self.pose if self.measured_at is None else moved(self.pose, self.measured_at)

    @property
    def covariance(self) -> Array:
        """Covariance `(6, 6)` of `pose` including the floor calibration leaves."""
        floored = with_floor(self.measured)
        if self.measured_at is None:
            return floored
        return moved(replace(self.measured, covariance=floored), -self.measured_at).covariance

    def seen_from(self, place: Place) -> TargetPose:
        """The same pose in the frame of a place of the target."""
        pose = moved(self.pose, place.position)
        at = np.zeros(3) if self.measured_at is None else self.measured_at
        return replace(
            self,
            target=place.name,
            frame=place.name,
            pose=replace(pose, rotation=pose.rotation @ place.rotation),
            measured_at=place.rotation.T @ (at - place.position),
        )

    def camera_in_target(self) -> tuple[Array, Array, Array]:
        """Rotation target from camera, position of the camera [m; target], covariance with floor in target axes."""
        return inverse(self.pose, self.covariance)


@dataclass(slots=True)
class TrackedFrame:
    """One image on its way through the tracker.

    Attributes:
        sight: the image, with what is known about its moment.
        detections: tags already decoded in it.
        poses: that are published.
        refused: why a target has none.
        found: targets that are followed.
        started: targets whose decoded tags were judged.
    """

    sight: ImageSight
    detections: list[Detection] = field(default_factory=list)
    poses: list[TargetPose] = field(default_factory=list)
    refused: dict[str, PoseRefusal] = field(default_factory=dict)
    found: set[str] = field(default_factory=set)
    started: set[str] = field(default_factory=set)


@dataclass(slots=True)
class Track:
    """State of one target.

    Attributes:
        coast: longest time without a pose [s].
        misses: images since the last accepted pose.
        decoded_at: when one of its tags was last decoded [s].
        branches: hypotheses from the images before; None before the first.
        published: times [s] and poses of the newest images that were published; also of a track that was lost.
    """

    coast: float
    misses: int = 0
    decoded_at: float = -np.inf
    branches: Branches | None = None
    published: deque[tuple[float, Pose]] = field(default_factory=lambda: deque(maxlen=3))
    _found: list[tuple[ImageSight, Pose]] = field(default_factory=list)

    @property
    def is_live(self) -> bool:
        """Whether there is a pose to predict from."""
        return bool(self._found)

    @property
    def has_velocity(self) -> bool:
        """Whether two recent poses exist."""
        return len(self._found) > 1

    @property
    def last(self) -> Pose:
        """The newest accepted pose; the track must be live."""
        return self._found[-1][1]

    @property
    def last_seen(self) -> ImageSight:
        """The image it was measured in."""
        return self._found[-1][0]

    def accept(self, seen: ImageSight, pose: Pose) -> None:
        """Remember a pose and the image it came from, in place of another one of that image."""
        if self._found and self.last_seen.time == seen.time:
            self._found.pop()
        self._found = [*(self._found[-1:] if self.goes_on(seen.time) else []), (seen, pose)]
        self.misses = 0

    def goes_on(self, time: float) -> bool:
        """Whether an image at a time [s] is one of this track: after the last pose, and not too late."""
        return self.is_live and 0.0 < time - self.last_seen.time <= self.coast

    def lose(self) -> None:
        """Forget all but where it was published: a wrong lock must not predict itself."""
        self._found.clear()
        self.branches = None
        self.misses = 0
        self.decoded_at = -np.inf

    def carry(self, by: Array) -> None:
        """Go on with another point of the same rigid target, `by` from its origin `(3,)` [m; target].

        What is known of a print's bend, and of its motion while rows are read, stays with the print.
        """

        def carried(pose: Pose) -> Pose:
            alone = replace(pose, motion=None, known_motion=None, seen_motion=None, bend=None, known_bend=None)
            return moved(alone, by)

        self._found = [(seen, carried(pose)) for seen, pose in self._found]
        self.published = deque(((time, carried(pose)) for time, pose in self.published), maxlen=self.published.maxlen)
        self.branches = None if self.branches is None else self.branches.moved(by)

    def can_be_at(self, time: float, pose: Pose) -> bool:
        """Whether the target can have moved to a pose since it was published last, by its range."""
        if not self.published:
            return True
        (then, last), certain = self.published[-1], LIMITS.certainty
        moved = certain.deviations * LIMITS.edges.speed_sd * (time - then)
        return abs(pose.range_m - last.range_m) <= abs(moved) + max(certain.wrong_m, certain.wrong_share * pose.range_m)

    def predict(self, seen: ImageSight) -> Pose:
        """Expected pose in an image.

        Motion is taken in the camera frame: in the target's an error of tilt would swing the position by the range.
        With attitudes the turn of the camera is taken out first and put back for the new image.
        """
        last_seen, last = self._found[-1]
        turned = seen.turned_since(last_seen)
        position, rotation = last.position, last.rotation
        speed: Array | None = None
        speed_sd = 0.0
        if self.has_velocity:
            before_seen, before = self._found[-2]
            passed = last_seen.time - before_seen.time
            earlier = last_seen.turned_since(before_seen) if turned is not None else None
            # Constant velocity: x(t) = x1 + (t - t1) / (t1 - t0) (x1 - R x0); R turns x0 into the camera axes of t1.
            step = last.position - (before.position if earlier is None else earlier @ before.position)
            position = last.position + (seen.time - last_seen.time) / passed * step
            speed = step / passed
            if earlier is None:
                rotation = last.rotation @ before.rotation.T @ last.rotation
                # Whatever the camera turned is in the step, and does not change the range: where it leads, too.
                sight = position / float(np.linalg.norm(position))
                speed = speed + ((last.range_m - before.range_m) / passed - float(speed @ sight)) * sight
            speed_sd = float(np.sqrt(last.covariance[2, 2] + before.covariance[2, 2])) / passed
        known = known_motion(position, speed, seen.turning, speed_sd)
        if turned is not None:
            rotation, position = turned @ last.rotation, turned @ position
        return replace(last, rotation=rotation, position=position, known_motion=known)


def known_motion(place: Array, speed: Array | None, turning: Turning | None, speed_sd: float = 0.0) -> UnknownsEstimate:
    """Prior of the camera's motion while an image is read.

    Args:
        place: of the target `(3,)` [m; RDF].
        speed: of the target by the images before `(3,)` [m/s; RDF].
        turning: of the camera by the vehicle's attitude.
        speed_sd: deviation of the speed along the optical axis that the images leave [m/s].
    """
    limits = LIMITS.edges
    rate, spread = np.zeros(3), limits.turning_sd
    if turning is not None:
        rate, spread = turning.rate, turning.sd
        if speed is None:
            spread += limits.speed_sd / float(np.linalg.norm(place))
    along = limits.speed_sd if speed is None else hypot(SINCE, speed_sd)
    expected = motion_of(place, np.zeros(3) if speed is None else speed, rate)
    return UnknownsEstimate(expected, np.diag([spread] * 3 + [along]) ** 2)


MOVED: Final = 16.3
"""Squared distance of a bend from what was known of it, from which that was wrong: chi-square(3), one in 1000."""
LASTS: Final = 300.0
"""Correlation time of a bend [s]; chosen."""


class LearnedBend:
    """The bend of one print: what near edges showed is carried on, and returns to the prior within minutes."""

    def __init__(self, prior: UnknownsEstimate | None) -> None:
        self._prior = self._last = prior
        self._time = -np.inf

    def at(self, time: float) -> UnknownsEstimate | None:
        """Estimate at a time; None for a target that does not bend."""
        if self._prior is None or self._last is None:
            return None
        kept = exp(-max(time - self._time, 0.0) / LASTS)
        mean = kept * self._last.mean + (1.0 - kept) * self._prior.mean
        return UnknownsEstimate(mean, kept**2 * self._last.covariance + (1.0 - kept**2) * self._prior.covariance)

    def learn(self, time: float, pose: Pose) -> None:
        """Take in what the edges of a published pose say."""
        if pose.bend is None or pose.known_bend is None or pose.source != "edges":
            return
        surprise = pose.bend.mean - pose.known_bend.mean
        is_learned = self._last is not self._prior
        is_moved = is_learned and float(surprise @ pose.known_bend.information @ surprise) > MOVED
        # A sheet that moved is measured again.
        self._last, self._time = self._prior if is_moved else pose.bend, time


RATE_SD: Final = 0.1
"""Deviation of the motion in an image from its mean between the images beside it, each axis [rad/s] and [m/s]."""
BESIDE: Final = 0.05
"""Farthest that images beside another one are from it [s]."""


def learn_rows(shutter: Shutter, published: Sequence[tuple[float, Pose]]) -> None:
    """Tell a shutter how the camera moved in the last but one image, by the images beside it: times [s] and poses."""
    if not shutter.is_open or len(published) < 3:
        return
    (start, before), (middle, between), (end, after) = published
    if not (0.0 < middle - start < BESIDE and 0.0 < end - middle < BESIDE) or between.seen_motion is None:
        return
    # P' = -w x P + s e for the target's place P: what is seen of both is one. The turn about the sight is apart.
    turned = -np.asarray(cv2.Rodrigues(after.rotation @ before.rotation.T)[0], dtype=np.float64).ravel()
    sight = between.position / between.range_m
    turning, speed = (turned @ sight) * sight / (end - start), (after.position - before.position) / (end - start)
    known = UnknownsEstimate(motion_of(between.position, speed, turning), RATE_SD**2 * np.eye(MOTIONS))
    shutter.learn(known, between.seen_motion)


class Measurer(NamedTuple):
    """What measures one target: its fits, what is learnt of its print, and what judges a fit."""

    fitter: TargetFitter
    bend: LearnedBend
    judge: Judge


class Follower:
    """Finds and follows one target.

    Attributes:
        name: of the target.
        track: its memory.
        level: how it lies by the attitude.
        judge: decides about its poses.
        contradicting: the pose of the newest image that contradicts the attitude; none without one.
    """

    def __init__(
        self,
        target: Target,
        projection: Projection,
        detector: Detector,
        mounting: Mounting | None,
        cfg: TrackerSection,
    ) -> None:
        self.name = target.name
        self.track = Track(cfg.coast)
        self.level = LevelKnowledge(target.level, mounting, cfg)
        self.contradicting: Pose | None = None
        self._cfg, self._detector, self._turn = cfg, detector, 0
        self._projection = projection
        self._measure_by(self._measurer_of(target))

    def _measurer_of(self, target: Target) -> Measurer:
        fitter = TargetFitter(target, self._projection)
        return Measurer(fitter, LearnedBend(fitter.bend_known), Judge(fitter, self.level, self._cfg))

    def _measure_by(self, measurer: Measurer) -> None:
        self._fitter, self._bend, self.judge = measurer

    def side_px(self, pose: Pose) -> float:
        """Side of its largest tag in an image, by a pose [px]."""
        return self._fitter.side_px(pose)

    def follow(self, frame: TrackedFrame) -> None:
        """Try to find the target where it should be."""
        sight, track = self.level.sight(frame.sight), self.track
        self._fitter.effort = 0
        if not track.goes_on(sight.time):
            track.lose()
            return
        # An attitude that jumps, or has a swapped sign, turns a prediction away from a target that is where it was.
        ways = [sight, sight.without_attitude()] if sight.turned_since(track.last_seen) is not None else [sight]
        if any(self._measured(frame, self._starts(seen)) for seen in ways):
            return
        window = self._fitter.window(self._predicted(sight), sight.pixels.shape)
        if window is not None:
            found = self._detector.search(sight.pixels, TONES[track.misses % len(TONES)], window)
            frame.detections.extend(found)
            self.start(frame, found, "roi")

    def _starts(self, seen: ImageSight) -> Iterator[tuple[FoundBy, Pose]]:
        """The prediction, and the last pose carried over: before it where the image does not show what it expects."""
        track, predicted = self.track, self._predicted(seen)
        is_expected = track.has_velocity or seen.turned_since(track.last_seen) is not None
        if is_expected and self._fitter.cells.shows(seen.pixels, predicted):
            yield "predicted", predicted
            is_expected = False
            if self._fitter.effort >= MOST_EFFORT:
                return
        carried = self._fitter.carried(track.last_seen.pixels, seen.pixels, track.last)
        if carried is not None:
            yield "flow", replace(predicted, rotation=carried.rotation, position=carried.position)
        if is_expected and (carried is None or self._fitter.effort < MOST_EFFORT):
            yield "predicted", predicted

    def _with_climb(self, seen: ImageSight, start: Pose) -> Pose:
        """The start of a track's second image with the speed that both ranges tell: rows make a tilt of a climb."""
        if not self._fitter.projection.shutter.rolls or self.track.has_velocity:
            return start
        found = self._fitter.refine(seen.pixels, start)
        if found is None or found.inliers < LIMITS.agreement.blind or not self.track.goes_on(seen.time):
            return start
        ahead = replace(self.track)
        ahead.accept(seen, found)
        return replace(start, known_motion=ahead.predict(seen).known_motion)

    def _measured(self, frame: TrackedFrame, starts: Iterable[tuple[FoundBy, Pose]]) -> bool:
        """Whether the target is found from one of several starts; it is followed then, and published if believed."""
        seen = self.level.sight(frame.sight)
        for mode, start in starts:
            verdict = self.judge.measure(seen, self._with_climb(seen, start), self.track.branches)
            if self._is_believed(frame, verdict):
                self._follow(frame, verdict, mode)
                return True
        against = self.contradicting
        if against is None or not self.judge.is_plainly_there(seen, against):
            return False
        self._follow(frame, FitVerdict(against, PoseRefusal.ATTITUDE), "predicted")
        return True

    def _is_believed(self, frame: TrackedFrame, verdict: FitVerdict) -> bool:
        """Whether the target is followed where a verdict puts it: no gate, and no other start, speaks against it."""
        pose, against = verdict.pose, self.contradicting
        if pose is not None and (against is None or not prefers(against, pose)):
            if not verdict.contradicts:
                return True
            self.contradicting = pose
        frame.refused[self.name] = verdict.refusal or PoseRefusal.ATTITUDE
        return False

    def _follow(self, frame: TrackedFrame, verdict: FitVerdict, mode: FoundBy) -> None:
        """Follow a detected target, and publish it if it is certain."""
        pose, track, time = verdict.pose, self.track, frame.sight.time
        if pose is None or not self._decode_again(frame, pose):
            return
        frame.found.add(self.name)
        track.accept(self.level.sight(frame.sight), pose)
        track.branches = verdict.branches or track.branches
        if verdict.refusal is not None:
            frame.refused[self.name] = verdict.refusal
        else:
            track.published.append((time, pose))
            self._bend.learn(time, pose)
            learn_rows(self._fitter.projection.shutter, track.published)
            frame.refused.pop(self.name, None)
            self.contradicting = None
            known = self.name, self._fitter.target.frame, pose, verdict.ratio, verdict.decided_by, mode
            frame.poses.append(self._published(TargetPose(*known, time - track.decoded_at)))
        if verdict.alone is not None:
            self.level.learn(frame.sight, verdict.alone)

    def _published(self, found: TargetPose) -> TargetPose:
        """What is published of a pose of what is followed."""
        return found

    def settle(self, frame: TrackedFrame) -> None:
        """Let what contradicts the attitude speak against it; the image that leaves it out is looked at without."""
        against, self.contradicting = self.contradicting, None
        if against is not None and self.level.learn(frame.sight, against):
            self.start(frame, frame.detections, "search")
            if self.track.is_live and all(found.target != self.name for found in frame.poses):
                self._measured(frame, [("predicted", against)])
        self.track.misses += self.name not in frame.found

    def decode_age(self, frame: TrackedFrame) -> float | None:
        """Time since a tag of the target was last decoded [s]; None without a track and without a tag in the image."""
        age = 0.0 if self._own(frame.detections) else frame.sight.time - self.track.decoded_at
        return age if isfinite(age) else None

    def forget(self) -> None:
        """Forget the track, where the target was, and how it lies."""
        self.track.lose()
        self.track.published.clear()
        self.level.forget()
        self.contradicting = None

    def start(self, frame: TrackedFrame, found: Sequence[Detection], mode: FoundBy) -> None:
        """Start or restart the track from decoded tags of any target, found in some way."""
        tags = self._own(found)
        if not tags:
            return
        frame.started.add(self.name)
        seen, track = self.level.sight(frame.sight), self.track
        bend = self._bend.at(seen.time)
        starts = [
            replace(pose, known_motion=known_motion(pose.position, None, seen.turning), known_bend=bend)
            for pose in solve(tags, self._fitter.projection)
        ]
        candidates = self._fitter.cold(seen.pixels, starts)
        if candidates and not any(track.can_be_at(seen.time, pose) for pose in candidates):
            frame.refused[self.name] = PoseRefusal.OFF_COURSE
            return
        verdict = self.judge.first(seen, candidates)
        if not self._is_believed(frame, verdict):
            return
        track.lose()
        track.decoded_at = seen.time
        self._follow(frame, verdict, mode)

    def _decode_again(self, frame: TrackedFrame, pose: Pose) -> bool:
        """Decode the followed target once a period; false ends the track."""
        track, pixels, now = self.track, frame.sight.pixels, frame.sight.time
        overdue = now - track.decoded_at - self._cfg.redetect_period
        if overdue < 0.0:
            return True
        window = self._fitter.window(pose, pixels.shape)
        found = self._search_again(pixels, window) if window is not None else []
        tags = self._own(found)
        frame.detections.extend(found)
        if tags and self._fitter.disagreement(pose, tags) < HALF:
            track.decoded_at = now
            return True
        # Clear cells stand in for a tag that cannot be decoded: one that leaves the image, or is partly hidden.
        if not tags and (overdue < self._cfg.coast or self._fitter.cells.evidence(pixels, pose).is_clear):
            return True
        frame.refused[self.name] = PoseRefusal.DECODED_ELSEWHERE if tags else PoseRefusal.NOT_DECODED
        track.lose()
        self.start(frame, found, "roi")
        return False

    def _search_again(self, pixels: Grey, window: Part) -> list[Detection]:
        """Tags of a part of the image; a search that finds none of the target's rests, then another has its turn."""
        turn, rests = divmod(self._turn, LIMITS.search.beside_every)
        self._turn += 1
        if rests:
            return []
        x0, y0, x1, y1 = window
        shrunk = 1 + min(x1 - x0, y1 - y0) // LARGE_PX
        found = self._detector.search(pixels, TONES[turn % len(TONES)], window, shrunk)
        self._turn -= bool(self._own(found))
        return found

    def _own(self, found: Sequence[Detection]) -> list[tuple[Tag, Detection]]:
        """The target's own tags among decoded ones."""
        tags = self._fitter.target.tags
        return [(tag, one) for one in found for tag in tags if tag.code == one.code]

    def _predicted(self, seen: ImageSight) -> Pose:
        """What the track expects in an image, with what is known of the print's bend."""
        return replace(self.track.predict(seen), bend=None, known_bend=self._bend.at(seen.time))

"""Following one target from image to image: prediction, fit, gates, re-detection, and starting anew.

How its print bends is a slow state, as paper moves in wind and sun only: an image far away cannot tell a bend from a
tilt, so what near ones showed is carried on and forgotten slowly.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from math import exp
from typing import Final

import cv2
import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.ambiguity import prefers
from mkdaemon.vision.pose.bend import Bend
from mkdaemon.vision.pose.carry import Carrier
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import MOTIONS, KnownMotion, Shutter, motion_of
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.detector import FIRST, NEARBY, Detector
from mkdaemon.vision.tags.tagmap import Tag, Target
from mkdaemon.vision.track.alarms import ImageHealth
from mkdaemon.vision.track.attitude import Mounting, Sight
from mkdaemon.vision.track.checks import Checks
from mkdaemon.vision.track.judge import Judge, Verdict
from mkdaemon.vision.track.result import FoundBy, Frame, TargetPose
from mkdaemon.vision.track.track import Track, known_motion

Window = tuple[int, int, int, int]
"""`(x0, y0, x1, y1)` [px], end exclusive."""
LARGE_PX: Final = 160
"""Side of a window from which half the resolution reads a target: 4 px a cell where its tag fills the window."""
MOST_EFFORT: Final = 5
"""Spent on an image from which no other start is fitted, in fits to edges: one to grey values, and one to edges."""


class OwnSearch:
    """Searches windows for the tags of one target.

    Args:
        target: whose tags.
        detector: that decodes.
    """

    def __init__(self, target: Target, detector: Detector) -> None:
        self._target, self._detector = target, detector
        self._turn = 0

    def again(self, pixels: Grey, window: Window) -> list[Detection]:
        """Tags of a part of the image; a search that finds none of the target's rests, then another has its turn."""
        turn, rests = divmod(self._turn, LIMITS.track.search_every)
        self._turn += 1
        if rests:
            return []
        x0, y0, x1, y1 = window
        ways = FIRST if min(x1 - x0, y1 - y0) >= LARGE_PX else NEARBY
        found = self._detector.search(pixels, ways[turn % len(ways)], window)
        self._turn -= bool(self.own(found))
        return found

    def nearby(self, pixels: Grey, window: Window, misses: int) -> list[Detection]:
        """Tags of a part of the image, searched in another way after every miss."""
        return self._detector.search(pixels, NEARBY[misses % len(NEARBY)], window)

    def own(self, found: Sequence[Detection]) -> list[tuple[Tag, Detection]]:
        """The target's own tags among decoded ones."""
        own = {(tag.family.name, tag.tag_id): tag for tag in self._target.tags}
        pairs = ((own.get((detection.family, detection.tag_id)), detection) for detection in found)
        return [(tag, detection) for tag, detection in pairs if tag is not None]


MOVED: Final = 16.3
"""Squared distance of a bend from what was known of it, from which that was wrong: chi-square(3), one in 1000."""
LASTS: Final = 300.0
"""Correlation time of a bend [s]; chosen."""


class LearnedBend:
    """The bend of one print: a process that returns to what is known without any image within minutes."""

    def __init__(self, prior: Bend | None) -> None:
        self._prior = self._last = prior
        self._time = -np.inf

    def at(self, time: float) -> Bend | None:
        """What is known at a time; none for a target that does not bend."""
        if self._prior is None or self._last is None:
            return None
        kept = exp(-max(time - self._time, 0.0) / LASTS)
        mean = kept * self._last.mean + (1.0 - kept) * self._prior.mean
        return Bend(mean, kept**2 * self._last.covariance + (1.0 - kept**2) * self._prior.covariance)

    def learn(self, time: float, pose: Pose) -> None:
        """Take in what the edges of a published pose say; its fit asked with what was known here.

        Grey values of a target far away hardly tell a bend from a tilt, and the lens and light they leave unexplained
        are larger: learned from them as well, the bend was off by 2.7 deviations (three flights of a bent print, 298
        images), from edges alone by 1.1.
        """
        if pose.bend is None or pose.known_bend is None or pose.source != "edges":
            return
        surprise = pose.bend.mean - pose.known_bend.mean
        is_learned = self._last is not self._prior
        is_moved = is_learned and float(surprise @ pose.known_bend.information @ surprise) > MOVED
        # A sheet that moved, or was learned wrong, is learned anew; one that its file does not expect is learned, too.
        self._last, self._time = self._prior if is_moved else pose.bend, time


RATE_SD: Final = 0.1
"""Deviation of the motion in an image from its mean between the images beside it, each axis [rad/s] and [m/s]."""
BESIDE: Final = 0.05
"""Farthest that images beside another one are from it [s]."""


class RowsWatch:
    """Tells a shutter how the camera moved while it read an image, from where the images beside it see the target.

    Args:
        shutter: of the camera.
    """

    def __init__(self, shutter: Shutter) -> None:
        self._shutter = shutter
        self._found: deque[tuple[float, Pose]] = deque(maxlen=3)

    def pose_found(self, time: float, pose: Pose) -> None:
        """Take in a published pose; the one before lies between two others then."""
        if not self._shutter.is_open:
            return
        self._found.append((time, pose))
        if len(self._found) < 3:
            return
        (start, before), (middle, between), (end, after) = self._found
        if not (0.0 < middle - start < BESIDE and 0.0 < end - middle < BESIDE) or between.seen_motion is None:
            return
        # P' = -w x P + s e for the target's place P: what is seen of both is one. The turn about the sight is apart.
        turned = -np.asarray(cv2.Rodrigues(after.rotation @ before.rotation.T)[0], dtype=np.float64).ravel()
        sight = between.position / between.range_m
        turning, speed = (turned @ sight) * sight / (end - start), (after.position - before.position) / (end - start)
        known = KnownMotion(motion_of(between.position, speed, turning), np.full(MOTIONS, RATE_SD))
        self._shutter.learn(known, between.seen_motion)


class Follower:
    """Finds and follows one target.

    Attributes:
        name: of the target.
        track: its memory.
        judge: decides about poses of the followed target.
    """

    def __init__(
        self,
        target: Target,
        projection: Projection,
        detector: Detector,
        health: ImageHealth,
        mounting: Mounting | None,
        cfg: TrackerSection,
    ) -> None:
        self.name = target.name
        self.track = Track(cfg.coast)
        self._target = target
        self._search, self._health = OwnSearch(target, detector), health
        self._mounting = mounting
        self._cfg = cfg
        self._fitter = TargetFitter(target, projection)
        self._bend = LearnedBend(self._fitter.bend_known)
        self._rows = RowsWatch(self._fitter.shutter)
        self._carrier = Carrier(target, projection)
        self._checks = Checks(self._fitter, self.track, cfg, mounting)
        self.judge = Judge(self._checks)

    def follow(self, frame: Frame) -> None:
        """Try to find the target where it should be."""
        sight = self._seen(frame)
        self._fitter.effort = 0
        track = self.track
        if not track.goes_on(sight.time):
            track.lose()
            return
        predicted = self._predicted(sight)
        ways = [sight]
        if track.knows_turn(sight, self._mounting):
            # An attitude that jumps, or has a swapped sign, turns a prediction away from a target that is where it was.
            ways.append(sight.without_attitude())
        for seen in ways:
            expected = self._predicted(seen)
            if self._measured(frame, expected, self._starts(seen, expected)):
                return
        window = self._fitter.window(predicted, sight.pixels.shape)
        if window is not None:
            found = self._search.nearby(sight.pixels, window, track.misses)
            frame.detections.extend(found)
            self.start(frame, found, "roi")

    def _starts(self, seen: Sight, predicted: Pose) -> Iterator[tuple[FoundBy, Pose]]:
        """The prediction, and the last pose carried over: before it where the image does not show what it expects.

        The likeliest start, and the other until as much as an image may take is spent on it.
        """
        track = self.track
        is_expected = track.has_velocity or track.knows_turn(seen, self._mounting)
        if is_expected and self._fitter.shows(seen.pixels, predicted):
            yield "predicted", predicted
            is_expected = False
            if self._fitter.effort >= MOST_EFFORT:
                return
        carried = self._carrier.shift(track.last_seen.pixels, seen.pixels, track.last)
        if carried is not None:
            yield "flow", replace(predicted, rotation=carried.rotation, position=carried.position)
        if is_expected and (carried is None or self._fitter.effort < MOST_EFFORT):
            yield "predicted", predicted

    def _with_climb(self, seen: Sight, start: Pose) -> Pose:
        """The start of a track's second image with the speed that both ranges tell.

        Under a rolling shutter a climb looks like a tilt, and does not change the range half way through the image. A
        fit that few edges agree with may have taken them for their neighbours, and its range says nothing.
        """
        if not self._fitter.shutter.rolls or self.track.has_velocity:
            return start
        found = self._fitter.refine(seen.pixels, start)
        if found is None or found.inliers < LIMITS.agreement.blind:
            return start
        known = self.track.motion_with(seen, found, self._mounting)
        return start if known is None else replace(start, known_motion=known)

    def _measured(self, frame: Frame, predicted: Pose, starts: Iterable[tuple[FoundBy, Pose]]) -> bool:
        """Whether the target is found from one of several starts; it is followed then, and published if believed."""
        seen = self._seen(frame)
        for mode, start in starts:
            verdict = self.judge.measure(seen, self._with_climb(seen, start), predicted)
            pose = self._believed(frame, verdict)
            if pose is not None:
                self._follow(frame, verdict, pose, mode)
                return True
        against = frame.contradicting.get(self.name)
        if against is None or not self._checks.is_plainly_there(seen, against):
            return False
        self._follow(frame, Verdict(against, PoseRefusal.ATTITUDE), against, "predicted")
        return True

    def _believed(self, frame: Frame, verdict: Verdict) -> Pose | None:
        """The pose of a verdict to follow the target with; none where a gate or the image speaks against it.

        What contradicts the attitude from one start counts for all starts of the image: of poses that agree with it
        none is believed that the image likes less.
        """
        pose, against = verdict.pose, frame.contradicting.get(self.name)
        if pose is not None and (against is None or not prefers(against, pose)):
            if not verdict.contradicts:
                return pose
            frame.contradicting[self.name] = pose
        frame.refused[self.name] = verdict.refusal or PoseRefusal.ATTITUDE
        return None

    def _follow(self, frame: Frame, verdict: Verdict, pose: Pose, mode: FoundBy) -> None:
        """Follow a target that is found, and publish it if it is believed."""
        seen = self._seen(frame)
        if not self._decode_again(frame, pose):
            return
        self.track.accept(seen, pose)
        self.track.branches = verdict.branches or self.track.branches
        if verdict.refusal is not None:
            frame.follow(self.name, verdict.refusal)
        else:
            self._publish(frame, verdict, pose, mode)
        if verdict.alone is not None:
            self._checks.level.learn(frame.sight, verdict.alone)

    @property
    def contradicted_deg(self) -> float | None:
        """By how much the images of the target contradict the attitude [deg]; none while they do not."""
        return self._checks.level.contradicted_deg

    def settle(self, frame: Frame) -> None:
        """Let what contradicts the attitude speak against it, and count an image that shows no target.

        The image that leaves the attitude out is looked at without.
        """
        against = frame.contradicting.pop(self.name, None)
        if against is not None and self._checks.level.learn(frame.sight, against):
            self.start(frame, frame.detections, "search")
            if self.track.is_live and all(found.target != self.name for found in frame.poses):
                self._measured(frame, self._predicted(self._seen(frame)), [("predicted", against)])
        self.track.misses += not frame.has(self.name)

    def forget(self) -> None:
        """Forget the track, where the target was, and how it lies."""
        self.track.lose()
        self.track.published = None
        self._checks.level.forget()

    def start(self, frame: Frame, found: Sequence[Detection], mode: FoundBy) -> None:
        """Start or restart the track from decoded tags.

        Args:
            frame: the image.
            found: tags of any target.
            mode: how they were found.
        """
        tags = self._search.own(found)
        if not tags:
            return
        frame.started.add(self.name)
        seen, mounting = self._seen(frame), self._mounting
        candidates = self._fitter.cold(
            seen.pixels,
            tags,
            lambda place: known_motion(place, None, seen.turning_flu, mounting),
            self._bend.at(seen.time),
        )
        if candidates and not any(self.track.can_be_at(seen.time, pose) for pose in candidates):
            frame.refused[self.name] = PoseRefusal.OFF_COURSE
            return
        verdict = self.judge.first(seen, candidates)
        pose = self._believed(frame, verdict)
        if pose is None:
            return
        if verdict.refusal is not None and self.track.branches is not None and self.track.branches.is_decided:
            frame.refused[self.name] = verdict.refusal
            return
        self.track.lose()
        self.track.decoded_at = seen.time
        self._follow(frame, verdict, pose, mode)

    def _decode_again(self, frame: Frame, pose: Pose) -> bool:
        """Decode the followed target once a period; false ends the track."""
        track, pixels = self.track, frame.sight.pixels
        now = frame.sight.time
        overdue = now - track.decoded_at - self._cfg.redetect_period
        if overdue < 0.0:
            return True
        window = self._fitter.window(pose, pixels.shape)
        found = self._search.again(pixels, window) if window is not None else []
        tags = self._search.own(found)
        frame.detections.extend(found)
        if tags:
            if self._fitter.disagreement(pose, tags) < HALF:
                track.decoded_at = now
                return True
            frame.refused[self.name] = PoseRefusal.DECODED_ELSEWHERE
            track.lose()
            self.start(frame, found, "roi")
            return False
        # Clear cells stand in for a tag that cannot be decoded: one that leaves the image, or is partly hidden.
        if overdue < self._cfg.coast or self._checks.are_cells_clear(frame.sight, pose):
            return True
        frame.refused[self.name] = PoseRefusal.NOT_DECODED
        track.lose()
        return False

    def _seen(self, frame: Frame) -> Sight:
        """An image as the target is looked for in it: without an attitude that its images contradict."""
        return self._checks.level.sight(frame.sight)

    def _predicted(self, seen: Sight) -> Pose:
        """What the track expects in an image, with what is known of the print's bend."""
        expected = self.track.predict(seen, self._mounting)
        return replace(expected, bend=None, known_bend=self._bend.at(seen.time))

    def _publish(self, frame: Frame, verdict: Verdict, pose: Pose, mode: FoundBy) -> None:
        time = frame.sight.time
        self.track.published = time, pose.range_m
        self._bend.learn(time, pose)
        self._rows.pose_found(time, pose)
        frame.refused.pop(self.name, None)
        frame.contradicting.pop(self.name, None)
        self._health.note(pose, self._fitter.side_px(pose))
        frame.poses.append(
            TargetPose(
                self.name,
                self._target.frame,
                pose,
                verdict.ratio,
                verdict.decided_by,
                mode,
                time - self.track.decoded_at,
            )
        )

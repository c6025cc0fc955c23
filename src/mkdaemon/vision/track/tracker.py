"""Following targets from image to image, and publishing only what has passed every gate.

The order of an image: health of the image; for each known target prediction, fit and gates; for what is left optical
flow, a search around the prediction, and at last a search of the whole image. A pose nobody contradicts is published,
everything else is a refusal with its reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import DetectorSection, TrackerSection
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.pose.ambiguity import Choice
from mkdaemon.vision.pose.carry import Carrier
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.detection import Detection, Stage
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import Tag, TagMap
from mkdaemon.vision.track.alarms import ImageHealth
from mkdaemon.vision.track.attitude import AttitudeHistory, Mounting
from mkdaemon.vision.track.judge import FLOW_THROUGH, Judge, Sight
from mkdaemon.vision.track.result import TargetPose, VisionResult
from mkdaemon.vision.track.track import Track

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

UNDECODED_GRACE = 1.0
"""How much longer than the re-detection period a track may go on without a decoded tag [s]."""
BLIND_GRACE = 5.0
"""The same without attitude while the target is too near for a whole tag in the image, or inertia backs it [s]."""
STRONG_BITS = 0.8
"""Cells this clear stand in for a decoded tag, where none fits into the image."""
PREDICT_THROUGH = 18
"""Images without a pose over which a prediction with attitude stays good enough to start from."""
RETRY_DECODE = 0.1
"""Pause between attempts to decode a tracked tag [s]."""
SEARCH_EVERY = 5
"""While one target is tracked, the others are searched for in every n-th image."""
DECODE_AGREES = 0.5
"""Decoded corners and pose may differ by this many cells."""


@dataclass(slots=True)
class _Frame:
    """One image on its way through the tracker."""

    image: CameraImage
    sight: Sight
    detections: list[Detection] = field(default_factory=list)
    poses: list[TargetPose] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    followed: set[str] = field(default_factory=set)


class Tracker:
    """Finds and follows the targets of one camera.

    Without intrinsics it reports tags and never a pose.
    """

    def __init__(
        self,
        tagmap: TagMap,
        intrinsics: Intrinsics | None,
        mounting: Mounting | None = None,
        cfg: TrackerSection | None = None,
        detector: DetectorSection | None = None,
    ) -> None:
        self._cfg = cfg or TrackerSection()
        self._mounting = mounting
        self._tagmap = tagmap
        self.detector = Detector(tagmap.whitelist, detector)
        self._fitters: dict[str, TargetFitter] = {}
        self._carriers: dict[str, Carrier] = {}
        self._health = ImageHealth(*((intrinsics.width, intrinsics.height) if intrinsics is not None else (None, None)))
        if intrinsics is not None:
            projection = Projection(intrinsics)
            self._fitters = {t.name: TargetFitter(t, projection, self._cfg) for t in tagmap.targets}
            self._carriers = {t.name: Carrier(t, projection) for t in tagmap.targets}
        self._targets = {target.name: target for target in tagmap.targets}
        self._tracks = {target.name: Track() for target in tagmap.targets}
        self._judges = {
            name: Judge(fitter, self._tracks[name], self._cfg, mounting) for name, fitter in self._fitters.items()
        }
        self._count = 0

    def update(self, image: CameraImage, attitude: AttitudeHistory | None = None) -> VisionResult:
        """Process one image.

        Args:
            image: the newest image of the camera.
            attitude: recent attitudes of the vehicle; used for prediction and, over level targets, as a gate.

        Returns:
            Tags, poses, alarms and refusals; never raises on account of an image.
        """
        alarms = self._health.check(image.pixels)
        if "wrong_size" in alarms or "frozen" in alarms:
            self.reset()
            return VisionResult(image.camera, image.sequence, image.captured_at, (), (), tuple(alarms))
        known = attitude is not None and self._mounting is not None
        enu_from_flu = attitude.at(image.captured_at, self._cfg.max_attitude_age) if known and attitude else None
        frame = _Frame(image, Sight(image.pixels, image.captured_at, enu_from_flu))
        self._count += 1
        if self._fitters:
            for name in self._fitters:
                self._follow(frame, name)
            self._search(frame)
            for name, track in self._tracks.items():
                if name not in frame.followed and all(found.target != name for found in frame.poses):
                    track.misses += 1
                    if track.is_live and image.captured_at - track.last_time > self._cfg.coast:
                        track.lose()
        else:
            alarms.append("uncalibrated")
            frame.detections.extend(self._climb(frame))
        return VisionResult(
            image.camera,
            image.sequence,
            image.captured_at,
            tuple(frame.detections),
            tuple(frame.poses),
            tuple(alarms),
            tuple(frame.refused.items()),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        for track in self._tracks.values():
            track.lose()

    def _follow(self, frame: _Frame, name: str) -> None:
        """Try to find a tracked target where it should be."""
        track, fitter = self._tracks[name], self._fitters[name]
        now = frame.sight.time
        if track.is_live and not 0.0 < now - track.last_time < 1.0:
            track.lose()
        if not track.is_live:
            return
        predicted, used = track.predict(now, frame.sight.enu_from_flu, self._mounting)
        for mode, start in self._starts(frame, name, predicted, used):
            measured = self._judges[name].measure(frame.sight, start, predicted)
            if isinstance(measured, str):
                frame.refused[name] = measured
                continue
            pose, doubt = measured
            if not self._confirm(frame, name, pose):
                return
            if doubt:
                track.accept(now, pose, frame.sight.enu_from_flu, frame.sight.pixels)
                track.in_doubt = track.in_doubt or doubt == "ambiguous"
                frame.refused[name] = doubt
                frame.followed.add(name)
            else:
                track.in_doubt = False
                self._publish(frame, name, Choice(pose, float("inf"), "track"), mode)
            return
        window = fitter.window(predicted, frame.sight.pixels.shape)
        if window is not None:
            expected = None if track.in_doubt else predicted
            self._adopt(frame, name, self._nearby(frame, window, track.misses), "roi", expected)

    def _starts(self, frame: _Frame, name: str, predicted: Pose, used: bool) -> Iterator[tuple[str, Pose]]:
        """Where to begin fitting, the cheapest first; later ones are computed only when the earlier ones failed."""
        track = self._tracks[name]
        if track.misses < (PREDICT_THROUGH if used else FLOW_THROUGH) and (used or track.has_velocity):
            yield "predicted", predicted
        if track.misses < FLOW_THROUGH and track.image is not None:
            for carried in self._carriers[name].starts(track.image, frame.sight.pixels, track.last, predicted):
                yield "flow", carried

    def _confirm(self, frame: _Frame, name: str, pose: Pose) -> bool:
        """Decode a tracked target once a period; false ends the track."""
        track, fitter = self._tracks[name], self._fitters[name]
        now = frame.sight.time
        overdue = now - track.decoded_at - self._cfg.redetect_period
        if overdue < 0.0:
            return True
        if now - track.tried_at >= RETRY_DECODE:
            track.tried_at = now
            window = fitter.window(pose, frame.sight.pixels.shape)
            found = self.detector.search(frame.sight.pixels, "decimate1", window) if window is not None else []
            tags = self._tags_of(name, found)
            frame.detections.extend(found)
            if tags:
                if fitter.disagreement_px(pose, tags) < DECODE_AGREES:
                    track.decoded_at = now
                    return True
                frame.refused[name] = "decoded_elsewhere"
                track.lose()
                self._adopt(frame, name, found, "roi", None)
                return False
        if overdue < UNDECODED_GRACE:
            return True
        bits = fitter.match(frame.sight.pixels, pose)
        # Where no tag is whole in the image, decoding cannot succeed and its failure says nothing.
        cut = not fitter.shows_whole_tag(pose, frame.sight.pixels.shape)
        judge = self._judges[name]
        witness = judge.tilt(frame.sight, pose) is not None or ((cut or judge.backed) and overdue < BLIND_GRACE)
        if bits is not None and bits >= STRONG_BITS and witness:
            return True
        frame.refused[name] = "not_decoded"
        track.lose()
        return False

    def _search(self, frame: _Frame) -> None:
        """Look for what is still missing in the whole image."""
        found_names = {pose.target for pose in frame.poses}
        missing = [name for name in self._fitters if name not in found_names | frame.followed]
        if not missing or (found_names and self._count % SEARCH_EVERY):
            return
        # Right after a miss the prediction is still good; the whole image comes when the neighbourhood gave nothing.
        if all(self._tracks[name].is_live and self._tracks[name].misses < 1 for name in missing):
            return
        found = self._climb(frame)
        frame.detections.extend(found)
        for name in missing:
            self._adopt(frame, name, found, "search", None)

    def _climb(self, frame: _Frame) -> list[Detection]:
        """Cheap search; when it sees nothing, half of the thorough ones, in turn."""
        first, *rest = self.detector.stages
        found = self.detector.search(frame.sight.pixels, first)
        for stage in rest[self._count % 2 :: 2]:
            found = found or self.detector.search(frame.sight.pixels, stage)
        return found

    def _nearby(self, frame: _Frame, window: tuple[int, int, int, int], misses: int) -> list[Detection]:
        """Search a part of the image; what is missed for longer may lie in a shadow."""
        stages: tuple[Stage, ...] = ("log", "equalised") if misses % 2 else ("decimate1",)
        found: list[Detection] = []
        for stage in stages:
            found = found or self.detector.search(frame.sight.pixels, stage, window)
        return found

    def _tags_of(self, name: str, found: Sequence[Detection]) -> list[tuple[Tag, Detection]]:
        owners = self._tagmap.owners
        owned = ((owners[detection.family, detection.tag_id], detection) for detection in found)
        return [(tag, detection) for (target, tag), detection in owned if target.name == name]

    def _adopt(self, frame: _Frame, name: str, found: Sequence[Detection], mode: str, predicted: Pose | None) -> None:
        """Start or restart a track from decoded tags."""
        if mode == "roi":
            frame.detections.extend(found)
        tags = self._tags_of(name, found)
        if not tags:
            return
        track, judge = self._tracks[name], self._judges[name]
        candidates = self._fitters[name].cold(frame.sight.pixels, tags)
        choice = judge.choose_first(frame.sight, candidates, predicted.rotation if predicted is not None else None)
        if isinstance(choice, str):
            frame.refused[name] = choice
            if choice == "ambiguous":
                self._doubt(frame, name, candidates, mode)
            return
        track.decoded_at = track.tried_at = frame.sight.time
        track.in_doubt = False
        track.branches = judge.begun(frame.sight, [choice.pose], decided=True)
        self._publish(frame, name, choice, mode)

    def _doubt(self, frame: _Frame, name: str, candidates: Sequence[Pose], mode: str) -> None:
        """Let a track decide between a pose and its mirror image, or start one that waits until it can."""
        rivals = sorted((pose for pose in candidates if pose.source != "corners"), key=lambda pose: pose.loss)
        if not rivals:
            return
        track, judge, now = self._tracks[name], self._judges[name], frame.sight.time
        joined: tuple[Pose, str] | str = "ambiguous"
        if track.is_live:
            predicted, _ = track.predict(now, frame.sight.enu_from_flu, self._mounting)
            joined = judge.rejoin(frame.sight, rivals, predicted)
        if not isinstance(joined, str) and not joined[1]:
            track.decoded_at = track.tried_at = now
            track.in_doubt = False
            self._publish(frame, name, Choice(joined[0], float("inf"), "track"), mode)
            return
        if isinstance(joined, str):
            if track.is_live and not track.in_doubt and track.misses <= FLOW_THROUGH:
                return
            track.lose()
            track.branches = judge.begun(frame.sight, rivals, decided=False)
            joined = rivals[0], "ambiguous"
        track.decoded_at = track.tried_at = now
        track.accept(now, joined[0], frame.sight.enu_from_flu, frame.sight.pixels)
        track.in_doubt = True
        frame.refused[name] = joined[1]
        frame.followed.add(name)

    def _publish(self, frame: _Frame, name: str, choice: Choice, mode: str) -> None:
        track, fitter, now = self._tracks[name], self._fitters[name], frame.sight.time
        track.accept(now, choice.pose, frame.sight.enu_from_flu, frame.sight.pixels)
        frame.refused.pop(name, None)
        self._health.note(choice.pose, fitter.side_px(choice.pose))
        frame.poses.append(
            TargetPose(
                name,
                self._targets[name].frame,
                choice.pose,
                choice.ratio,
                choice.decided_by,
                mode,
                fitter.match(frame.sight.pixels, choice.pose),
                now - track.decoded_at,
            )
        )

"""Following targets from image to image, and publishing only what has passed every gate.

The order of an image: health of the image; for each known target prediction, fit and gates; for what is left optical
flow, a search around the prediction, and at last a search of the whole image. A pose nobody contradicts is published,
everything else is a refusal with its reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import DetectorSection, TrackerSection
from mkdaemon.vision.alarms import ImageHealth
from mkdaemon.vision.ambiguity import Choice, choose
from mkdaemon.vision.attitude import AttitudeHistory, Mounting, fuse_level, tilt_error
from mkdaemon.vision.detection import Detection, Stage
from mkdaemon.vision.detector import Detector
from mkdaemon.vision.edgefit import Level
from mkdaemon.vision.fitting import TargetFitter
from mkdaemon.vision.gates import certainty_fault, fit_fault, innovation_fault
from mkdaemon.vision.image import CameraImage
from mkdaemon.vision.intrinsics import Intrinsics
from mkdaemon.vision.pose import Pose, angle_between, largest_variance
from mkdaemon.vision.projection import Projection
from mkdaemon.vision.result import TargetPose, VisionResult
from mkdaemon.vision.tagmap import Tag, TagMap
from mkdaemon.vision.track import Track

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

UNDECODED_GRACE = 1.0
"""How much longer than the re-detection period a track may go on without a decoded tag [s]."""
BLIND_GRACE = 5.0
"""The same without attitude while the target is too near for a whole tag in the image [s]."""
STRONG_BITS = 0.8
"""Cells this clear stand in for a decoded tag, where none fits into the image."""
PREDICT_THROUGH = 18
"""Images without a pose over which a prediction with attitude stays good enough to start from."""
FLOW_THROUGH = 5
"""Images over which optical flow from the last good one finds its way."""
LATE_BITS = 0.8
"""Cells have to be this clear when a track comes back after more than that many images."""
IMAGE_DECIDES_PX = 24.0
"""Cells from this size on show perspective; without attitude, smaller ones are checked for the mirrored pose [px]."""
BLURRED_PX = 3.5
"""Width of an edge from which perspective drowns in blur [px]."""
ODD_RMS = 1.7
"""Residual over its usual value from which a small tag is not believed without attitude."""
HARMLESS = float(np.radians(2.0))
"""Rivals this close are published as one pose with the doubt in its covariance [rad]."""
SMALL_TILT = float(np.radians(1.5))
"""Below this tilt the mirrored pose is the pose [rad]."""
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
    enu_from_flu: Array | None
    detections: list[Detection] = field(default_factory=list)
    poses: list[TargetPose] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    followed: set[str] = field(default_factory=set)

    @property
    def pixels(self) -> Grey:
        """The image."""
        return self.image.pixels


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
        self._health = ImageHealth(*((intrinsics.width, intrinsics.height) if intrinsics is not None else (None, None)))
        if intrinsics is not None:
            projection = Projection(intrinsics)
            self._fitters = {t.name: TargetFitter(t, projection, self._cfg) for t in tagmap.targets}
        self._targets = {target.name: target for target in tagmap.targets}
        self._tracks = {target.name: Track() for target in tagmap.targets}
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
        frame = _Frame(image, enu_from_flu)
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
        now = frame.image.captured_at
        if track.is_live and not 0.0 < now - track.last_time < 1.0:
            track.lose()
        if not track.is_live:
            return
        predicted, used = track.predict(now, frame.enu_from_flu, self._mounting)
        for mode, start in self._starts(frame, name, predicted, used):
            measured = self._measure(frame, name, start, predicted)
            if measured is None:
                continue
            pose, doubt = measured
            if not self._confirm(frame, name, pose):
                return
            if doubt:
                track.accept(now, pose, frame.enu_from_flu, frame.pixels)
                track.in_doubt = track.in_doubt or doubt == "ambiguous"
                frame.refused[name] = doubt
                frame.followed.add(name)
            else:
                track.in_doubt = False
                self._publish(frame, name, Choice(pose, float("inf"), "track"), mode)
            return
        window = fitter.window(predicted, frame.pixels.shape)
        if window is not None:
            stage: Stage = "log" if track.misses % 2 else "decimate1"
            expected = None if track.in_doubt else predicted
            self._adopt(frame, name, self.detector.search(frame.pixels, stage, window), "roi", expected)

    def _starts(self, frame: _Frame, name: str, predicted: Pose, used: bool) -> Iterator[tuple[str, Pose]]:
        """Where to begin fitting, the cheapest first; later ones are computed only when the earlier ones failed."""
        track = self._tracks[name]
        if (track.misses == 0 and track.has_velocity) or (used and track.misses < PREDICT_THROUGH):
            yield "predicted", predicted
        if track.misses < FLOW_THROUGH and track.image is not None:
            carried = self._fitters[name].flow(track.image, frame.pixels, track.last, predicted)
            if carried is not None:
                yield "flow", carried

    def _measure(self, frame: _Frame, name: str, start: Pose, predicted: Pose) -> tuple[Pose, str] | None:
        """Fit from one start.

        Returns:
            The pose and why it must not be published (empty when it may be); none when a gate stopped it.
        """
        fitter = self._fitters[name]
        pose = fitter.refine(frame.pixels, start)
        fault = self._hard_fault(frame, name, pose, predicted) if pose is not None else "no_fit"
        if pose is not None and not fault:
            settled = self._settle_mirror(frame, name, pose, predicted)
            if settled is None:
                return pose, "ambiguous"
            fault = "" if settled is pose else self._hard_fault(frame, name, settled, predicted)
            if not fault:
                fused = self._fused(frame, name, settled)
                seen = self._tilt(frame, name, settled) is not None
                odd = "" if seen else self._residual_fault(name, fused)
                return fused, odd or certainty_fault(fused, has_attitude=seen)
        level = self._level(frame, name)
        if level is not None:
            # A free fit may follow something lying over the target: hold the tilt and try again.
            held = fitter.refine_level(frame.pixels, replace(start, rotation=predicted.rotation), level)
            if held is not None and not self._hard_fault(frame, name, held, predicted):
                return held, certainty_fault(held, has_attitude=True)
        frame.refused[name] = fault
        return None

    def _residual_fault(self, name: str, pose: Pose) -> str:
        """A small tag that suddenly fits much worse than before has slipped into a wrong place that looks alike."""
        usual = self._tracks[name].usual_rms
        cell_px = self._fitters[name].side_px(pose) / self._targets[name].tags[0].family.black_cells
        odd = usual is not None and pose.source == "edges" and pose.rms_px > ODD_RMS * usual + 0.01
        return "residual" if odd and cell_px < IMAGE_DECIDES_PX / 2 else ""

    def _level(self, frame: _Frame, name: str) -> Level | None:
        if frame.enu_from_flu is None or self._mounting is None or not self._targets[name].level:
            return None
        up = (frame.enu_from_flu @ self._mounting.flu_from_cam).T[:, 2]
        return Level(up, float(np.radians(self._cfg.attitude_sd_deg)))

    def _fused(self, frame: _Frame, name: str, pose: Pose) -> Pose:
        """The pose with what the attitude knows about its tilt."""
        if frame.enu_from_flu is None or self._mounting is None or not self._targets[name].level:
            return pose
        spread = float(np.radians(self._cfg.attitude_sd_deg))
        return fuse_level(pose, self._mounting, frame.enu_from_flu, spread)

    def _settle_mirror(self, frame: _Frame, name: str, pose: Pose, predicted: Pose) -> Pose | None:
        """Without attitude a track can slip into the mirrored pose: image and track choose, or nobody does (none)."""
        fitter = self._fitters[name]
        cell_px = fitter.side_px(pose) / self._targets[name].tags[0].family.black_cells
        blurred = pose.blur_px is not None and pose.blur_px > BLURRED_PX
        known = self._tilt(frame, name, pose) is not None
        if known or (cell_px > IMAGE_DECIDES_PX and not blurred) or pose.tilt < SMALL_TILT:
            return pose
        rival = fitter.mirrored(frame.pixels, pose)
        if rival is None:
            return pose
        expected = None if self._tracks[name].in_doubt else predicted.rotation
        choice = choose([pose, rival], min_ratio=self._cfg.min_ambiguity_ratio, predicted=expected)
        if choice is None and pose.source == "edges" and cell_px < IMAGE_DECIDES_PX / 3:
            grey = fitter.by_grey_values(frame.pixels, (pose, rival))
            choice = choose(grey, min_ratio=self._cfg.min_ambiguity_ratio, predicted=expected) if grey else None
        if choice is not None:
            return choice.pose
        between = angle_between(pose.rotation, rival.rotation)
        if between > HARMLESS:
            return None
        better = min((pose, rival), key=lambda candidate: candidate.loss)
        covariance = better.covariance.copy()
        covariance[3:, 3:] += (between / 2) ** 2 * np.eye(3)
        return replace(better, covariance=covariance)

    def _fault(self, frame: _Frame, name: str, pose: Pose) -> str:
        """The first gate a newly found pose fails; empty when it passes all."""
        fused = self._fused(frame, name, pose)
        return self._hard_fault(frame, name, pose, None) or certainty_fault(
            fused, has_attitude=self._tilt(frame, name, pose) is not None
        )

    def _hard_fault(self, frame: _Frame, name: str, pose: Pose, predicted: Pose | None) -> str:
        """The first sign that a pose is wrong; empty without any."""
        fault = fit_fault(pose, self._cfg)
        if fault:
            return fault
        late = predicted is not None and self._tracks[name].misses > FLOW_THROUGH
        bits = self._fitters[name].match(frame.pixels, pose)
        if bits is not None and bits < (LATE_BITS if late else self._cfg.min_bit_correlation):
            return "bits"
        tilt = self._tilt(frame, name, pose)
        if tilt is not None and tilt > self._tilt_gate(pose):
            return "attitude"
        if predicted is not None:
            track = self._tracks[name]
            age = frame.image.captured_at - track.last_time
            has_attitude = frame.enu_from_flu is not None
            return innovation_fault(pose, predicted, age, has_attitude=has_attitude, has_velocity=track.has_velocity)
        return ""

    def _tilt(self, frame: _Frame, name: str, pose: Pose) -> float | None:
        if frame.enu_from_flu is None or self._mounting is None or not self._targets[name].level:
            return None
        return tilt_error(pose.rotation, self._mounting, frame.enu_from_flu)

    def _tilt_gate(self, pose: Pose) -> float:
        spread = float(np.sqrt(largest_variance(pose.covariance[3:, 3:])))
        return float(np.radians(self._cfg.attitude_gate_deg)) + min(spread, float(np.radians(1.0)))

    def _confirm(self, frame: _Frame, name: str, pose: Pose) -> bool:
        """Decode a tracked target once a period; false ends the track."""
        track, fitter = self._tracks[name], self._fitters[name]
        now = frame.image.captured_at
        overdue = now - track.decoded_at - self._cfg.redetect_period
        if overdue < 0.0:
            return True
        if now - track.tried_at >= RETRY_DECODE:
            track.tried_at = now
            window = fitter.window(pose, frame.pixels.shape)
            found = self.detector.search(frame.pixels, "decimate1", window) if window is not None else []
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
        bits = fitter.match(frame.pixels, pose)
        # Where no tag is whole in the image, decoding cannot succeed and its failure says nothing.
        cut = not fitter.shows_whole_tag(pose, frame.pixels.shape)
        witness = self._tilt(frame, name, pose) is not None or (cut and overdue < BLIND_GRACE)
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
        """Cheap search; when it sees nothing, one of the thorough ones in turn."""
        stages = self.detector.stages
        found = self.detector.search(frame.pixels, stages[0])
        if not found and len(stages) > 1:
            rest = stages[1:]
            found = self.detector.search(frame.pixels, rest[self._count % len(rest)])
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
        fitter, track = self._fitters[name], self._tracks[name]
        believable: list[Pose] = []
        for pose in fitter.cold(frame.pixels, tags):
            fault = fit_fault(pose, self._cfg) or self._bits_fault(frame, name, pose)
            if fault:
                frame.refused[name] = fault
            else:
                believable.append(pose)
        tilts = [self._tilt(frame, name, pose) for pose in believable]
        known = [tilt for tilt in tilts if tilt is not None]
        choice = choose(
            believable,
            min_ratio=self._cfg.min_ambiguity_ratio,
            tilt_errors=known if len(known) == len(believable) and known else None,
            tilt_gate=max((self._tilt_gate(pose) for pose in believable), default=0.0),
            predicted=predicted.rotation if predicted is not None else None,
        )
        if choice is None:
            if believable:
                frame.refused[name] = (
                    "attitude" if known and min(known) > self._tilt_gate(believable[0]) else "ambiguous"
                )
            return
        fault = self._fault(frame, name, choice.pose)
        if fault:
            frame.refused[name] = fault
            return
        track.decoded_at = track.tried_at = frame.image.captured_at
        track.in_doubt = False
        self._publish(frame, name, replace(choice, pose=self._fused(frame, name, choice.pose)), mode)

    def _bits_fault(self, frame: _Frame, name: str, pose: Pose) -> str:
        bits = self._fitters[name].match(frame.pixels, pose)
        return "bits" if bits is not None and bits < self._cfg.min_bit_correlation else ""

    def _publish(self, frame: _Frame, name: str, choice: Choice, mode: str) -> None:
        track, fitter, now = self._tracks[name], self._fitters[name], frame.image.captured_at
        track.accept(now, choice.pose, frame.enu_from_flu, frame.pixels)
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
                fitter.match(frame.pixels, choice.pose),
                now - track.decoded_at,
            )
        )

"""Measuring a target from a start and judging what came out, with everything known about it: track, attitude, image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.pose.ambiguity import SAME_POSE, Choice, choose
from mkdaemon.vision.pose.edgefit import Level
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import BLIND_GREY_RMS_PX, certainty_fault, fit_fault, innovation_fault
from mkdaemon.vision.pose.pose import Pose, angle_between, largest_variance
from mkdaemon.vision.track.attitude import Mounting, fuse_level, tilt_error
from mkdaemon.vision.track.branches import OVERRULED, Branches
from mkdaemon.vision.track.track import Track

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

FLOW_THROUGH = 5
"""Images over which optical flow from the last good one finds its way."""
LATE_BITS = 0.8
"""Cells have to be this clear when a track comes back after more than that many images."""
IMAGE_DECIDES_PX = 24.0
"""Cells from this size on show perspective; without attitude, smaller ones are checked for the mirrored pose [px]."""
BLURRED_PX = 3.5
"""Width of an edge from which perspective drowns in blur [px]."""
COLD_INLIERS = 0.9
"""Share of agreeing points asked of a pose that neither attitude nor inertia backs: an occluder's edge that fakes a
border leaves fewer."""
ODD_RMS = 1.7
"""Residual over its usual value from which a small tag is not believed without attitude."""
ODD_LEVEL_RMS = 5.0
"""The same beside an attitude, which leaves the range and the heading to the image."""
HARMLESS = float(np.radians(2.0))
"""Rivals this close are published as one pose with the doubt in its covariance [rad]."""
GREY_PX = 8.0
"""Cells below this tell rivals apart better by all their pixels than by their edges [px]."""
SURPRISING = 16.0
"""Squared distance from the course at which a pose is not published; of three degrees of freedom, one in 900."""
EXPECTED = 9.0
"""Squared distance from the course up to which inertia speaks for a pose."""
BACKING_SD = float(np.radians(1.0))
"""Deviation of the predicted direction up to which inertia can speak for a pose [rad]."""
SMALL_TILT = float(np.radians(1.5))
"""Below this tilt the mirrored pose is the pose [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One image with what is known about its moment.

    Attributes:
        pixels: `(h, w)` uint8.
        time: middle of the exposure [s].
        enu_from_flu: the vehicle's attitude then `(3, 3)`; none when unknown.
    """

    pixels: Grey
    time: float
    enu_from_flu: Array | None


class Judge:
    """Measures and judges one target.

    Attributes:
        backed: whether the images before and inertia spoke for the newest pose.
    """

    def __init__(self, fitter: TargetFitter, track: Track, cfg: TrackerSection, mounting: Mounting | None) -> None:
        self.fitter = fitter
        self.track = track
        self._cfg = cfg
        self._mounting = mounting
        self.backed = False

    def measure(self, seen: Sight, start: Pose, predicted: Pose) -> tuple[Pose, str] | str:
        """Fit from one start.

        Returns:
            The pose and why it must not be published (empty when it may be); the fault alone when a gate stopped it.
        """
        pose = self.fitter.refine(seen.pixels, start)
        fault = self._hard_fault(seen, pose, predicted) if pose is not None else "no_fit"
        if pose is not None and not fault:
            if self.tilt(seen, pose) is None:
                return self._weigh(seen, pose, predicted)
            return self._upheld(seen, self.fused(seen, pose))
        level = self._level(seen)
        if level is not None:
            # A free fit may follow something lying over the target: hold the tilt and try again.
            held = self.fitter.refine_level(seen.pixels, replace(start, rotation=predicted.rotation), level)
            if held is not None and not self._hard_fault(seen, held, predicted):
                return self._helped(seen, held)
        return fault

    def _upheld(self, seen: Sight, pose: Pose) -> tuple[Pose, str]:
        """Judge a fit that agrees with the attitude, and carry the course on with it."""
        before = self.track.branches
        branches = before.after(seen.time, [pose]) if before is not None and before.is_decided else None
        helped = self._helped(seen, pose)
        if branches is None or branches.best.missed:
            branches = self.begun(seen, [pose], decided=True)
        self.track.branches = branches
        return helped

    def _helped(self, seen: Sight, pose: Pose) -> tuple[Pose, str]:
        """A pose the attitude agrees with and why it must not be published; inertia helps uncertain ones."""
        odd = self._residual_fault(pose, ODD_LEVEL_RMS)
        if odd:
            return pose, odd
        fault, before = certainty_fault(pose, has_attitude=True), self.track.branches
        if not fault or before is None or not before.is_decided:
            return pose, fault
        prior = before.best.course.ahead(seen.time)
        if prior.angle_sd > BACKING_SD or prior.surprise(pose, 1.0) > EXPECTED:
            return pose, fault
        # Where points disagree, the others are less certain than they say.
        helped = prior.fused(replace(pose, covariance=pose.covariance / pose.inliers**4))
        return helped, certainty_fault(helped, has_attitude=True)

    def _weigh(self, seen: Sight, pose: Pose, predicted: Pose) -> tuple[Pose, str] | str:
        """Judge a fit without attitude, by its mirror image, the images before and the vehicle's inertia."""
        candidates = self._candidates(seen, pose)
        branches = self._continued(seen, candidates, predicted)
        if not branches.is_decided and len(candidates) > 1 and pose.source == "edges" and self._cell_px(pose) < GREY_PX:
            grey = self.fitter.by_grey_values(seen.pixels, candidates)
            # Blur that is not round leaves residuals there; such a fit says nothing.
            if grey and min(fit.rms_px for fit in grey) < BLIND_GREY_RMS_PX:
                branches = self._continued(seen, grey, predicted)
        chosen = branches.best.pose
        fault = "" if chosen is pose else self._hard_fault(seen, chosen, predicted)
        return fault or self._believed(seen, branches)

    def rejoin(self, seen: Sight, candidates: Sequence[Pose], predicted: Pose) -> tuple[Pose, str] | str:
        """Let a track that lost its target for some images choose between poses that were found anew.

        Returns:
            As `measure`.
        """
        rivals = [pose for pose in candidates if not self._hard_fault(seen, pose, predicted)]
        if self.track.branches is None or not rivals:
            return "ambiguous"
        return self._believed(seen, self.track.branches.after(seen.time, rivals))

    def _believed(self, seen: Sight, branches: Branches) -> tuple[Pose, str]:
        """Take over the branches of an image; their best pose and why it must not be published."""
        self.track.branches = branches
        self.backed = False
        chosen, prior = branches.best.pose, branches.best.prior
        if not branches.is_decided or branches.best.against > OVERRULED:
            return chosen, "ambiguous"
        fused = prior.fused(chosen) if prior is not None else chosen
        covariance = fused.covariance.copy()
        covariance[3:, 3:] += branches.doubt * np.eye(3)
        fused = replace(fused, covariance=covariance)
        # The branches allow for errors that last; to be published a pose has to fit by its own covariance.
        surprise = prior.surprise(chosen, 1.0) if prior is not None else 0.0
        if branches.best.missed or surprise > SURPRISING:
            return fused, "off_course"
        self.backed = prior is not None and prior.angle_sd < BACKING_SD and surprise < EXPECTED
        is_plain = self.backed or self._is_plain(seen, fused)
        if not is_plain and chosen.source == "edges" and chosen.inliers < COLD_INLIERS:
            return fused, "inliers"
        odd = "" if self.backed else self._residual_fault(fused)
        return fused, odd or certainty_fault(fused, has_attitude=False, is_plain=is_plain, is_backed=self.backed)

    def _candidates(self, seen: Sight, pose: Pose) -> list[Pose]:
        """A fit and, where perspective does not rule it out, its mirror image."""
        if self._shows_perspective(pose) or pose.tilt < SMALL_TILT:
            return [pose]
        rival = self.fitter.mirrored(seen.pixels, pose)
        if rival is None or angle_between(pose.rotation, rival.rotation) < SAME_POSE:
            return [pose]
        return [pose, rival]

    def _continued(self, seen: Sight, candidates: Sequence[Pose], predicted: Pose) -> Branches:
        """The branches of the track with the candidates of this image."""
        before, first = self.track.branches, candidates[0]
        if before is not None:
            return before.after(seen.time, candidates)
        if self._shows_perspective(first):
            return self.begun(seen, candidates, decided=True)
        expected = None if self.track.in_doubt else predicted.rotation
        choice = choose(candidates, min_ratio=self._cfg.min_ambiguity_ratio, predicted=expected)
        best = choice.pose if choice is not None else min(candidates, key=lambda candidate: candidate.loss)
        order = [best, *(other for other in candidates if other is not best)]
        return self.begun(seen, order, decided=choice is not None)

    def begun(self, seen: Sight, candidates: Sequence[Pose], *, decided: bool) -> Branches:
        """Branches that start in this image, the best candidate first."""
        return Branches.begin(seen.time, candidates, decided=decided, moving=self.fitter.target.moving)

    def _cell_px(self, pose: Pose) -> float:
        return self.fitter.side_px(pose) / self.fitter.target.tags[0].family.size_cells

    def _shows_perspective(self, pose: Pose) -> bool:
        """Whether the image alone tells a pose from its mirror image."""
        blurred = pose.blur_px is not None and pose.blur_px > BLURRED_PX
        return self._cell_px(pose) > IMAGE_DECIDES_PX and not blurred

    def _settle_mirror(self, seen: Sight, pose: Pose) -> Pose | None:
        """Ask a first pose that has no rival for its mirror image: the image chooses, or nobody does (none)."""
        if self.tilt(seen, pose) is not None:
            return pose
        rivals = self._candidates(seen, pose)
        choice = choose(rivals, min_ratio=self._cfg.min_ambiguity_ratio)
        if choice is None and pose.source == "edges" and self._cell_px(pose) < GREY_PX:
            grey = self.fitter.by_grey_values(seen.pixels, rivals)
            choice = choose(grey, min_ratio=self._cfg.min_ambiguity_ratio) if grey else None
        if choice is not None:
            return choice.pose
        between = angle_between(rivals[0].rotation, rivals[1].rotation)
        if between > HARMLESS:
            return None
        better = min(rivals, key=lambda candidate: candidate.loss)
        covariance = better.covariance.copy()
        covariance[3:, 3:] += (between / 2) ** 2 * np.eye(3)
        return replace(better, covariance=covariance)

    def choose_first(self, seen: Sight, candidates: Sequence[Pose], expected: Array | None) -> Choice | str:
        """Decide about poses from decoded tags, without or against a track.

        Args:
            seen: the image.
            candidates: fitted poses.
            expected: rotation a track expects; none without one.

        Returns:
            The choice, with the attitude's knowledge in it, or the reason of the refusal.
        """
        believable = [pose for pose in candidates if self._hard_fault(seen, pose, None) in ("", "attitude")]
        if not believable:
            return self._hard_fault(seen, candidates[0], None) if candidates else "no_fit"
        tilts = [self.tilt(seen, pose) for pose in believable]
        known = [tilt for tilt in tilts if tilt is not None]
        choice = choose(
            believable,
            min_ratio=self._cfg.min_ambiguity_ratio,
            tilt_errors=known or None,
            tilt_gate=max(self.tilt_gate(pose) for pose in believable),
            predicted=expected,
        )
        if choice is None and known:
            return self._levelled(seen, min(believable, key=lambda pose: pose.loss))
        if choice is None:
            return "ambiguous"
        borne_out = False
        if choice.pose.source == "edges" and choice.pose.inliers < COLD_INLIERS:
            # Hidden parts, or a border faked by what hides them: a held tilt tells these apart, or the edges seen.
            if known:
                return self._levelled(seen, choice.pose)
            borne_out = self.fitter.is_borne_out(seen.pixels, choice.pose)
            if not borne_out:
                return "inliers"
        if not known and choice.pose.source == "edges" and self._is_smeared(choice.pose):
            return "blurred"
        if choice.decided_by in ("unique", "image"):
            # Both starts may have run into one minimum, or one of them into none: the mirrored pose of a small tag is
            # asked for by name.
            settled = self._settle_mirror(seen, choice.pose)
            if settled is None:
                return "ambiguous"
            choice = replace(choice, pose=settled)
        fused = self.fused(seen, choice.pose)
        fault = self._hard_fault(seen, choice.pose, None) or certainty_fault(
            fused, has_attitude=bool(known), is_plain=borne_out
        )
        return fault or replace(choice, pose=fused)

    def _levelled(self, seen: Sight, pose: Pose) -> Choice | str:
        """Fit once more with the tilt held: something lying over one side gives a quad that is off by that much."""
        level = self._level(seen)
        if level is None or self._mounting is None or seen.enu_from_flu is None:
            return "attitude"
        vague = replace(pose, covariance=np.eye(6))
        start = fuse_level(vague, self._mounting, seen.enu_from_flu, 1e-3)
        held = self.fitter.refine_level(seen.pixels, replace(start, position=pose.position), level)
        if held is None or self._hard_fault(seen, held, None):
            return "attitude"
        fault = certainty_fault(held, has_attitude=True)
        return fault or Choice(held, float("inf"), "attitude")

    def _hard_fault(self, seen: Sight, pose: Pose, predicted: Pose | None) -> str:
        """The first sign that a pose is wrong; empty without any."""
        fault = fit_fault(pose, self._cfg)
        if fault:
            return fault
        late = predicted is not None and self.track.misses > FLOW_THROUGH
        bits = self.fitter.match(seen.pixels, pose)
        if bits is not None and bits < (LATE_BITS if late else self._cfg.min_bit_correlation):
            return "bits"
        tilt = self.tilt(seen, pose)
        if tilt is not None and tilt > self.tilt_gate(pose):
            return "attitude"
        if predicted is not None:
            age = seen.time - self.track.last_time
            has_attitude = seen.enu_from_flu is not None
            return innovation_fault(
                pose, predicted, age, has_attitude=has_attitude, has_velocity=self.track.has_velocity
            )
        return ""

    def _is_smeared(self, pose: Pose) -> bool:
        """Whether blur hides what perspective there is: both candidates then run into one pose that may be neither."""
        return pose.blur_px is not None and pose.blur_px > BLURRED_PX and self._cell_px(pose) < IMAGE_DECIDES_PX

    def _is_plain(self, seen: Sight, pose: Pose) -> bool:
        bits = self.fitter.match(seen.pixels, pose) if self._cell_px(pose) > IMAGE_DECIDES_PX else None
        return bits is not None and bits >= LATE_BITS

    def _residual_fault(self, pose: Pose, times: float = ODD_RMS) -> str:
        """A small tag that suddenly fits much worse than before has slipped into a wrong place that looks alike."""
        usual = self.track.usual_rms
        odd = usual is not None and pose.source == "edges" and pose.rms_px > times * usual + 0.01
        return "residual" if odd and self._cell_px(pose) < IMAGE_DECIDES_PX / 2 else ""

    def tilt(self, seen: Sight, pose: Pose) -> float | None:
        """Disagreement with the attitude [rad]; none over targets that are not level, or without attitude."""
        if seen.enu_from_flu is None or self._mounting is None or not self.fitter.target.level:
            return None
        return tilt_error(pose.rotation, self._mounting, seen.enu_from_flu)

    def tilt_gate(self, pose: Pose) -> float:
        """Largest disagreement that is believed of a pose [rad]."""
        spread = float(np.sqrt(largest_variance(pose.covariance[3:, 3:])))
        return float(np.radians(self._cfg.attitude_gate_deg)) + min(spread, float(np.radians(1.0)))

    def _level(self, seen: Sight) -> Level | None:
        if seen.enu_from_flu is None or self._mounting is None or not self.fitter.target.level:
            return None
        up = (seen.enu_from_flu @ self._mounting.flu_from_cam).T[:, 2]
        return Level(up, float(np.radians(self._cfg.attitude_sd_deg)))

    def fused(self, seen: Sight, pose: Pose) -> Pose:
        """The pose with what the attitude knows about its tilt."""
        if seen.enu_from_flu is None or self._mounting is None or not self.fitter.target.level:
            return pose
        spread = float(np.radians(self._cfg.attitude_sd_deg))
        return fuse_level(pose, self._mounting, seen.enu_from_flu, spread)

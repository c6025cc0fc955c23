"""Watches one camera fly: whether images, attitude and barometer agree with its camera file and its target files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import exp, hypot

import numpy as np
import numpy.typing as npt

from mkdaemon.telemetry.selfcal import SelfCalibration, TagSizeError
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.camera.calibration_file import Camera, mount_rotation
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.selfcal.camerafilter import LENS_AT, MOUNTING, SIZES_AT, CameraFilter
from mkdaemon.vision.selfcal.evidence import EvidenceMaker
from mkdaemon.vision.selfcal.heightfilter import HeightFilter
from mkdaemon.vision.selfcal.limits import SELFCAL
from mkdaemon.vision.selfcal.mounting import turned_rpy_deg
from mkdaemon.vision.tags.tagmap import TagMap, Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]


class TargetWatch:
    """What one target says about a camera.

    Args:
        target: seen by it.
        camera: its file, with the mount believed.
        has_mount: whether anybody said how it sits.
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].
    """

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
        """Take in an image in which the target was found."""
        side_px = float(self._camera.intrinsics.fx) * self.target.tags[0].size / max(float(pose.position[2]), 1e-3)
        if time < self._due or pose.source != "edges" or side_px < SELFCAL.side_px:
            return
        self._due = time + SELFCAL.period
        evidence = self._maker.look(pixels, pose)
        if evidence is not None:
            self._filter.image_seen(time, evidence, enu_from_flu)

    def scale_words(self) -> Iterator[str]:
        """What contradicts a size or the focal length, each with both numbers."""
        k = self._camera.intrinsics
        share, sd = self._known(LENS_AT, SELFCAL.focal_floor)
        certain = SELFCAL.settled_certain if sd <= SELFCAL.settled else SELFCAL.certain
        if self._tells(share, sd, SELFCAL.focal, certain):
            yield (
                f"focal length {k.fx:.1f} px in the camera file, {k.fx * exp(share):.1f} +- {k.fx * sd:.1f} px by"
                " the images: calibrate again"
            )
        largest = self.target.tags[0]
        for n, tag in enumerate(self.target.tags[1 : 1 + self._maker.sizes], start=SIZES_AT):
            share, sd = self._known(n, SELFCAL.size_floor)
            if self._tells(share, sd, SELFCAL.size):
                yield (
                    f"tag {tag.tag_id} of {self.target.name}: {1000 * tag.size:.1f} mm in its file,"
                    f" {1000 * tag.size * exp(share):.1f} +- {1000 * tag.size * sd:.1f} mm against tag"
                    f" {largest.tag_id}: measure the print"
                )
        share, sd = self._known(SIZES_AT + self._maker.sizes, SELFCAL.size_floor)
        if self._maker.is_spread and self._tells(share, sd, SELFCAL.size):
            yield (
                f"tag {largest.tag_id} of {self.target.name}: {1000 * largest.size:.1f} mm in its file,"
                f" {1000 * largest.size * exp(share):.1f} mm against the distances between tags: measure the print"
            )
        share, sd = self.heights.scale
        if self.heights.contradicts:
            way = self.heights.covered
            yield (
                f"a way of {way * (1 - share):.2f} +- {way * sd:.2f} m by the barometer is {way:.2f} m by the eyes"
                f" over {self.target.name}: measure the print, check the focal length"
            )

    def lens_words(self) -> Iterator[str]:
        """What contradicts principal point or distortion."""
        k = self._camera.intrinsics
        for n, (name, believed) in enumerate((("cx", k.cx), ("cy", k.cy)), start=LENS_AT + 1):
            off, sd = self._known(n, SELFCAL.centre_floor_px)
            if self._tells(off, sd, SELFCAL.centre_px):
                better = f"{believed + off:.1f} +- {sd:.1f}"
                yield f"{name} {believed:.1f} px in the camera file, {better} px by the images"
        off, sd = self._known(LENS_AT + 3, SELFCAL.k1_floor)
        if self._tells(off, sd, SELFCAL.k1):
            yield f"k1 {k.k1:.3f} in the camera file, {k.k1 + off:.3f} +- {sd:.3f} by the images"

    def mounting_words(self) -> Iterator[str]:
        """What contradicts the mounting."""
        found = [
            f"{word} {np.degrees(turn):+.1f} +- {np.degrees(sd):.1f} deg"
            for n, word in enumerate(("roll", "pitch", "yaw"))
            for turn, sd in (self._known(n, SELFCAL.mounting_floor),)
            if self._tells(turn, sd, SELFCAL.mounting)
        ]
        if found:
            rpy = ", ".join(f"{angle:.1f}" for angle in self._camera.mount.rpy_deg)
            better = ", ".join(f"{angle:.1f}" for angle in self.report().mount_rpy_deg)
            yield f"mount.rpy_deg is {rpy}, the flight says {better} ({', '.join(found)})"

    def report(self) -> SelfCalibration:
        """All estimates."""
        mean, sd = self._filter.mean, self._filter.sd
        known = np.where(sd[MOUNTING] < SELFCAL.mounting, mean[MOUNTING], 0.0)
        height, height_sd = self.heights.scale
        own = slice(SIZES_AT, SIZES_AT + self._maker.sizes)
        sizes = [(float(m), float(s)) for m, s in zip(mean[own], sd[own], strict=True)]
        return SelfCalibration(
            target=self.target.name,
            looks=self._filter.looks,
            mounting_deg=_three(np.degrees(mean[MOUNTING])),
            mounting_sd_deg=_three(np.degrees(sd[MOUNTING])),
            mount_believed_deg=self._camera.mount.rpy_deg,
            mount_rpy_deg=turned_rpy_deg(self._camera.mount, known),
            focal_percent=100.0 * float(mean[LENS_AT]),
            focal_sd_percent=100.0 * float(sd[LENS_AT]),
            centre_px=(float(mean[LENS_AT + 1]), float(mean[LENS_AT + 2])),
            centre_sd_px=(float(sd[LENS_AT + 1]), float(sd[LENS_AT + 2])),
            k1=float(mean[LENS_AT + 3]),
            k1_sd=float(sd[LENS_AT + 3]),
            sizes=tuple(
                TagSizeError(tag_id=tag.tag_id, size_percent=100.0 * size, size_sd_percent=100.0 * size_sd)
                for tag, (size, size_sd) in zip(self.target.tags[1:], sizes, strict=False)
            ),
            height_percent=100.0 * height,
            height_sd_percent=100.0 * height_sd,
            height_covered=self.heights.covered,
        )

    def _known(self, n: int, floor: float = 0.0) -> tuple[float, float]:
        """An unknown and its deviation, with what no image shows."""
        return float(self._filter.mean[n]), hypot(float(self._filter.sd[n]), floor)

    def _tells(self, value: float, sd: float, least: float, certain: float = SELFCAL.certain) -> bool:
        """Whether a difference is told: large enough to matter, and no accident."""
        return self._filter.looks >= SELFCAL.least_looks and abs(value) > max(least, certain * sd)


class SelfCheck:
    """Watches one camera; without a camera file there is nothing to watch.

    Args:
        tagmap: its targets.
        camera: its file, with the mount believed.
        has_mount: whether anybody said how it sits.
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].
    """

    def __init__(self, tagmap: TagMap, camera: Camera | None, attitude_sd: float, *, has_mount: bool) -> None:
        self._camera = camera
        targets = tagmap.targets if camera is not None else ()
        self._watches = {
            target.name: TargetWatch(target, camera, attitude_sd, has_mount=has_mount)
            for target in targets
            if camera is not None
        }
        self._alarms: dict[Alarm, str] = {}

    @property
    def alarms(self) -> dict[Alarm, str]:
        """What contradicts the camera file or a target file, with both numbers."""
        return self._alarms

    def image_seen(
        self,
        pixels: Grey,
        poses: Mapping[str, Pose],
        heights: Mapping[str, float],
        time: float,
        enu_from_flu: Array | None,
    ) -> None:
        """Take in an image.

        Args:
            pixels: `(h, w)` uint8.
            poses: of targets, by name.
            heights: of the vehicle over targets [m], by name.
            time: middle of the exposure [s].
            enu_from_flu: the vehicle's attitude then `(3, 3)`; none when unknown.
        """
        for name, pose in poses.items():
            watch = self._watches[name]
            watch.image_seen(pixels, pose, time, enu_from_flu)
            if not watch.target.moving and watch.target.level:
                watch.heights.pose_seen(time, heights[name])
        self._alarms = dict(self._judge())

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
        if scale:
            yield Alarm.SCALE, "; ".join(scale)
        lens = [words for watch in watches for words in watch.lens_words()]
        if lens:
            yield Alarm.LENS, f"{'; '.join(lens)}: calibrate again"
        mounting = [words for watch in watches for words in watch.mounting_words()]
        if mounting:
            yield Alarm.MOUNTING, f"{mounting[0]}: look at the camera's seat, then mkdaemon calibrate mount"

    def _sheet_words(self) -> Iterator[str]:
        if self._camera is None:
            return
        record, k = self._camera.calibration, self._camera.intrinsics
        if record.sheet_focal_mm > 0.0 and record.sheet_pixel_um > 0.0:
            expected = 1000.0 * record.sheet_focal_mm / record.sheet_pixel_um
            if abs(k.fx / expected - 1.0) > SELFCAL.sheet:
                yield f"focal length {k.fx:.0f} px in the camera file, {expected:.0f} px by the data sheet"


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z

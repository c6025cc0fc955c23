"""Rendered views with one wrong figure in the camera file or the target file: the alarm names it with both numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.camera import MountSection
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.camera.calibration_file import CalibrationRecord, Camera
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.selfcal.selfcheck import LENS_AT, CameraFilter, SelfCheck, TargetWatch
from mkdaemon.vision.tags.tagmap import TagMap, Target
from tests.vision.views import VGA, View, place, shipped

NESTED = "nested"
VIEWS = 20
RIGHT = Camera(intrinsics=VGA)


@dataclass(frozen=True, eq=False)
class Shot:
    pixels: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    enu_from_flu: np.ndarray


@cache
def shots() -> tuple[Shot, ...]:
    """Views from all sides, near enough to see the inner tag, with the attitude of a vehicle that looks down."""
    found = []
    for k in range(VIEWS):
        view = place(1.0 + 0.02 * k, 0.35, around=2.4 * k, roll=0.9 * k)
        seen = View(shipped(NESTED), view)
        found.append(Shot(seen.pixels, seen.rotation, seen.position, view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T))
    return tuple(found)


@cache
def far_shots() -> tuple[Shot, ...]:
    """The same from where the inner tag's cells are as small as can be read, 2.5 to 2.8 px."""
    views = [place(1.28 + 0.006 * k, 0.2, around=2.4 * k, roll=0.9 * k) for k in range(20)]
    shown = [View(shipped(NESTED), view) for view in views]
    turned = [view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T for view in views]
    return tuple(Shot(v.pixels, v.rotation, v.position, turn) for v, turn in zip(shown, turned, strict=True))


def watched(
    camera: Camera = RIGHT,
    target: Target | None = None,
    *,
    attitude: bool = True,
    seen: Callable[[], tuple[Shot, ...]] = shots,
) -> SelfCheck:
    """Show all views to a camera file and a target file."""
    target = target or shipped(NESTED)
    check = SelfCheck(TagMap((target,)), camera, np.radians(1.0))
    fit = EdgeFit(target, Projection(camera.intrinsics))
    share = camera.intrinsics.fx / VGA.fx
    # A track begins where the camera file puts the target: beyond half a cell a fit would not find it.
    aside = np.array([(VGA.cx - camera.intrinsics.cx) / VGA.fx, 0.0, 0.0])
    for k, shot in enumerate(seen()):
        seen_at = shot.position * (1.0, 1.0, share) + shot.position[2] * aside
        start = Pose(shot.rotation, seen_at, np.eye(6), "edges", 99, 0.1)
        pose = fit.fit(shot.pixels, start)
        assert pose is not None
        known = shot.enu_from_flu if attitude else None
        check.image_seen(shot.pixels, {target.name: (pose, 2.0)}, 0.1 * k, known)
    return check


def lens(**change: float) -> Camera:
    return Camera(intrinsics=VGA.model_copy(update=change))


def test_right_files_raise_no_alarm() -> None:
    check = watched()
    assert check.alarms == {}
    (report,) = check.reports()
    assert (report.target, report.looks) == ("pad", VIEWS)
    assert abs(report.focal_percent) < 0.3
    (size,) = report.sizes
    assert (size.tag_id, abs(size.size_percent) < 0.3) == (1, True)


def test_an_inner_tag_whose_cells_melt_is_wrong_by_its_deviation_at_most() -> None:
    (report,) = watched(seen=far_shots).reports()
    (size,) = report.sizes
    assert abs(size.size_percent) < 2.0 * size.size_sd_percent


@pytest.mark.parametrize("attitude", [True, False])
def test_a_focal_length_of_two_percent_too_much_is_named(attitude: bool) -> None:
    check = watched(lens(fx=612.0, fy=612.0), attitude=attitude)
    assert set(check.alarms) == {Alarm.SCALE}
    assert "focal length 612.0 px in the camera file, " in check.alarms[Alarm.SCALE]
    assert check.reports()[0].focal_percent == pytest.approx(-1.98, abs=0.4)


@pytest.mark.parametrize(
    ("share", "sd", "is_named"),
    [
        (0.019, 0.0055, True),  # settled: from three deviations, 0.3 % of them that no image shows
        (0.018, 0.0055, False),
        (0.036, 0.0115, False),  # what comes still moves it: from four
        (0.049, 0.0115, True),
        (0.009, 0.001, False),  # less is what a calibration leaves
    ],
)
def test_a_focal_length_that_has_settled_is_told_sooner(
    share: float, sd: float, is_named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = TargetWatch(shipped(NESTED), RIGHT, np.radians(1.0))
    known = SimpleNamespace(mean=np.zeros(12), sd=np.ones(12), sized=[], least=watch._filter.least)
    known.mean[LENS_AT], known.sd[LENS_AT] = share, sd
    monkeypatch.setattr(watch, "_filter", known)
    assert bool(list(watch.contradictions())) == is_named


def test_an_inner_tag_of_another_size_is_named() -> None:
    target = shipped(NESTED)
    outer, inner = target.tags
    check = watched(target=replace(target, tags=(outer, replace(inner, size=1.02 * inner.size))))
    assert set(check.alarms) == {Alarm.SCALE}
    assert "tag 1 of pad: 49.0 mm in its file, 48.1 +- 0.1 mm against tag 48" in check.alarms[Alarm.SCALE]


@cache
def single_shots() -> tuple[Shot, ...]:
    """A single tag at a slant, from 0.7 to 1.3 m."""
    views = [place(0.7 + 0.02 * k, 0.5, around=2.4 * k, roll=0.9 * k) for k in range(VIEWS)]
    shown = [View(shipped("single"), view) for view in views]
    turned = [view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T for view in views]
    return tuple(Shot(v.pixels, v.rotation, v.position, turn) for v, turn in zip(shown, turned, strict=True))


@pytest.mark.parametrize(("fx", "scale", "named"), [(600.0, 1.0, False), (612.0, 1.0, True), (600.0, 1.02, False)])
def test_one_tag_from_several_ranges_tells_a_focal_length_and_not_its_own_size(fx, scale, named) -> None:
    """No attitude and no barometer; a print of another size is at another range, and looks the same."""
    target = shipped("single")
    (tag,) = target.tags
    target = replace(target, tags=(replace(tag, size=scale * tag.size),))
    camera = lens(fx=fx, fy=fx)
    shown = tuple(replace(shot, position=scale * shot.position) for shot in single_shots())
    check = watched(camera, target, attitude=False, seen=lambda: shown)
    assert (Alarm.SCALE in check.alarms) == named
    assert check.reports()[0].focal_percent == pytest.approx(100 * np.log(600.0 / fx), abs=0.5)


def test_a_principal_point_and_a_distortion_are_named() -> None:
    check = watched(lens(cx=VGA.cx + 10.0, k1=-0.06))
    assert Alarm.LENS in check.alarms
    assert "cx 329.5 px in the camera file, 3" in check.alarms[Alarm.LENS]
    assert "k1 -0.060 in the camera file, " in check.alarms[Alarm.LENS]


def test_a_turned_mounting_is_named_with_the_angles_to_store() -> None:
    camera = Camera(intrinsics=VGA, mount=MountSection(rpy_deg=(3.0, 0.0, 0.0)))
    check = watched(camera)
    assert set(check.alarms) == {Alarm.MOUNTING}
    assert check.alarms[Alarm.MOUNTING].startswith("mount.rpy_deg is 3.0, 0.0, 0.0, the flight says ")
    (report,) = check.reports()
    assert report.mounting_deg[0] == pytest.approx(-3.0, abs=0.4)
    assert report.mount_rpy_deg[0] == pytest.approx(0.0, abs=0.4)


def test_tags_beside_each_other_say_how_large_they_are() -> None:
    """Edges where the truth puts them, of a board whose tags are 2 % larger in the file than on the paper."""
    nested = shipped(NESTED)
    pair = tuple(replace(tag, size=0.1, position=np.array([0.2 * k, 0.0, 0.0])) for k, tag in enumerate(nested.tags))
    assert len(watching(replace(nested, tags=pair), Projection(VGA)).sized) == 2
    assert len(watching(nested, Projection(VGA)).sized) == 1


def test_a_data_sheet_contradicts_a_calibration() -> None:
    sheet = CalibrationRecord(sheet_focal_mm=2.8, sheet_pixel_um=4.0)
    check = SelfCheck(TagMap((shipped(NESTED),)), Camera(intrinsics=VGA, calibration=sheet), 0.02)
    check.image_seen(np.zeros((480, 640), np.uint8), {}, 0.0, None)
    assert "focal length 600 px in the camera file, 700 px by the data sheet" in check.alarms[Alarm.SCALE]


def test_heights_that_grow_faster_than_the_barometers_are_named() -> None:
    check = SelfCheck(TagMap((shipped(NESTED),)), RIGHT, 0.02)
    far = Pose(np.eye(3), np.array([0.0, 0.0, 9.0]), np.eye(6), "photometric", 99, 0.1)
    for k in range(80):
        height = 4.0 - 3.0 * min(k / 60, 1.0)
        check.barometer_received(0.1 * k - 0.01, 5.0 + height)
        check.image_seen(np.zeros((2, 2), np.uint8), {"pad": (far, 1.3 * height)}, 0.1 * k, None)
    assert "m by the barometer is 3.84 m by vision over pad" in check.alarms[Alarm.SCALE]
    assert check.reports() == ()


def test_without_a_camera_file_nothing_is_watched() -> None:
    check = SelfCheck(TagMap((shipped(NESTED),)), None, 0.02)
    check.barometer_received(0.0, 1.0)
    check.image_seen(np.zeros((2, 2), np.uint8), {}, 0.0, None)
    assert (check.alarms, check.reports()) == ({}, ())


def watching(target: Target, projection: Projection) -> CameraFilter:
    return CameraFilter(target, projection, np.radians(1.0), None)


def focal_information(found: CameraFilter, pixels: np.ndarray, pose: Pose) -> float:
    """Of an exact print and lens of one unknown, whatever the pose and a shift."""
    evidence = found.look(pixels, pose)
    own = len(evidence.pull) - len(found.mean)
    asked = [*range(own), own + LENS_AT]
    return float(1.0 / np.linalg.inv(evidence.matrix[np.ix_(asked, asked)])[-1, -1])


def test_edges_along_rows_of_pixels_share_an_error_and_say_less() -> None:
    target = shipped(NESTED)
    along, across = (View(target, place(2.0, 0.15, around=0.0, roll=roll)) for roll in (0.0, 0.3))
    said = []
    for view in (along, across):
        pose = EdgeFit(target, Projection(VGA)).fit(
            view.pixels, Pose(view.rotation, view.position, np.eye(6), "edges", 99, 0.1)
        )
        assert pose is not None
        said.append(focal_information(watching(target, Projection(VGA)), view.pixels, pose))
    assert said[1] > 4.0 * said[0]


def test_a_rolling_shutter_and_a_hidden_target_say_less() -> None:
    target, shot = shipped(NESTED), shots()[0]
    pose = Pose(shot.rotation, shot.position, np.eye(6), "edges", 99, 0.1)
    still, rolling = (
        focal_information(
            watching(target, Projection(VGA.model_copy(update={"line_time": line_time}))), shot.pixels, pose
        )
        for line_time in (0.0, 6e-5)
    )
    assert rolling < 0.1 * still
    assert watching(target, Projection(VGA)).look(np.zeros_like(shot.pixels), pose) is None

"""Files that a flight contradicts: wrong figures are named with both numbers, what cannot be told apart is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.camera import MountSection
from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.selfcal import HEIGHTS_SURE
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.camera.calibration_file import CalibrationRecord, Camera
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.selfcal.selfcheck import (
    DECK,
    LENS_AT,
    MOUNTING,
    SIZES_AT,
    CameraFilter,
    HeightFilter,
    ImageEvidence,
    SelfCheck,
)
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
def shots(name: str = NESTED, nearest: float = 1.0, step: float = 0.02, tilt: float = 0.35) -> tuple[Shot, ...]:
    """Views from all sides, near enough to see the inner tag, with the attitude of a vehicle that looks down."""
    found = []
    for k in range(VIEWS):
        view = place(nearest + step * k, tilt, around=2.4 * k, roll=0.9 * k)
        seen = View(shipped(name), view)
        found.append(Shot(seen.pixels, seen.rotation, seen.position, view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T))
    return tuple(found)


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


@pytest.mark.parametrize("attitude", [True, False])
def test_a_focal_length_of_two_percent_too_much_is_named(attitude: bool) -> None:
    check = watched(lens(fx=612.0, fy=612.0), attitude=attitude)
    assert set(check.alarms) == {Alarm.SCALE}
    assert "focal length 612.0 px in the camera file, " in check.alarms[Alarm.SCALE]
    assert check.reports()[0].focal_percent == pytest.approx(-1.98, abs=0.4)


def test_an_inner_tag_of_another_size_is_named() -> None:
    target = shipped(NESTED)
    outer, inner = target.tags
    check = watched(target=replace(target, tags=(outer, replace(inner, size=1.02 * inner.size))))
    assert set(check.alarms) == {Alarm.SCALE}
    assert "tag 1 of pad: 49.0 mm in its file, 48.1 +- 0.1 mm against tag 48" in check.alarms[Alarm.SCALE]


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


def watching(target: Target, projection: Projection) -> CameraFilter:
    return CameraFilter(target, projection, np.radians(1.0), None)


def focal_information(found: CameraFilter, pixels: np.ndarray, pose: Pose) -> float:
    """Of an exact print and lens of one unknown, whatever the pose and a shift."""
    evidence = found.look(pixels, pose)
    own = len(evidence.pull) - len(found.mean)
    asked = [*range(own), own + LENS_AT]
    return float(1.0 / np.linalg.inv(evidence.matrix[np.ix_(asked, asked)])[-1, -1])


def test_a_rolling_shutter_and_a_hidden_target_say_less() -> None:
    target, shot = shipped(NESTED), shots()[0]
    pose = Pose(shot.rotation, shot.position, np.eye(6), "edges", 99, 0.1)
    rolls = Projection(VGA.model_copy(update={"line_time": 6e-5}))
    still, rolling = (focal_information(watching(target, lens), shot.pixels, pose) for lens in (PROJECTION, rolls))
    assert rolling < 0.1 * still
    assert watching(target, PROJECTION).look(np.zeros_like(shot.pixels), pose) is None


BELIEVED = LOOKING_DOWN.flu_from_cam
RIGID = replace(shipped("single"), bend=0.0)
PROJECTION = Projection(VGA)
TURN = np.radians([2.0, -2.2, 0.0])
DECK_NORMAL = np.array([np.radians(1.5), np.radians(-1.0), 1.0])


def evidence(rotation: np.ndarray, lens: np.ndarray | None = None) -> ImageEvidence:
    """An image that shows a pose exactly, and knows the lens where one is given."""
    known, pull = np.zeros(SIZES_AT + 1), np.zeros(SIZES_AT + 1)
    if lens is not None:
        known[LENS_AT:] = 1e6, 1.0, 1.0, 1e6, 0.0
        pull[LENS_AT:] = known[LENS_AT:] * lens
    return ImageEvidence(rotation, np.diag([*[1e6] * 6, *known]), np.array([*[0.0] * 6, *pull]))


def turned(
    yaw: Callable[[float], float], *, moving: bool = False, reported: float = 1.0, seconds: float = 10.0
) -> CameraFilter:
    """Ten images a second of a tilted deck with a camera that hangs otherwise than believed."""
    found = CameraFilter(replace(RIGID, moving=moving), PROJECTION, np.radians(1.0), BELIEVED)
    rng = np.random.default_rng(4)
    true_mounting = rotation_from_euler(float(TURN[0]), float(TURN[1]), 0.0) @ BELIEVED
    normal = DECK_NORMAL / np.linalg.norm(DECK_NORMAL)
    deck = np.column_stack([np.cross([0.0, 1.0, 0.0], normal), [0.0, 1.0, 0.0], normal])
    for time in np.arange(0.0, seconds, 0.1):
        roll, pitch = 0.07 * np.sin(1.3 * time), 0.07 * np.sin(2.1 * time + 1.0)
        seen = (rotation_from_euler(roll, pitch, yaw(time)) @ true_mounting).T @ deck
        tilt = reported * np.array([roll, pitch]) + np.radians(0.3) * rng.standard_normal(2)
        found.image_seen(float(time), evidence(seen), rotation_from_euler(*tilt, yaw(time)))
    return found


def test_yaw_tells_a_turned_mounting_from_a_tilted_deck() -> None:
    found = turned(lambda time: np.radians(60.0) * np.sin(0.6 * time))
    assert np.degrees(found.mean[MOUNTING] - TURN)[:2] == pytest.approx([0.0, 0.0], abs=0.3)
    assert np.degrees(found.mean[DECK] - DECK_NORMAL[:2]) == pytest.approx([0.0, 0.0], abs=0.3)
    assert np.degrees(found.sd[MOUNTING][:2]).max() < 0.3


def test_on_a_moving_deck_more_time_is_needed() -> None:
    still, moving = (turned(lambda time: 0.7 * time, moving=moves) for moves in (False, True))
    assert moving.sd[MOUNTING][0] > 1.1 * still.sd[MOUNTING][0]


DELAY = 0.1


def descend(time: float) -> float:
    return 4.0 - 3.0 * float(np.clip((time - 1.0) / 6.0, 0.0, 1.0))


def climbed(
    scale: float, height: Callable[[float], float] = descend, wander: float = 0.0, flights: int = 1, gap: float = 0.0
) -> HeightFilter:
    found = HeightFilter()
    rng = np.random.default_rng(2)
    off, start = 0.0, 0.0
    for _ in range(flights):
        for k in range(240):
            time = k / 30
            off = 0.9967 * off + wander * 0.0816 * rng.standard_normal()
            if k % 6 == 0:
                reading = 7.0 + round((height(time - DELAY) + off) / 0.05) * 0.05
                found.reading_received(start + time - 0.005, reading)
            found.pose_seen(start + time, height(time) * (1 + scale) + 0.005 * rng.standard_normal())
        start += 8.0 + gap
    return found


@pytest.mark.parametrize("scale", [0.0, 0.2, -0.15])
def test_a_way_down_gives_the_scale_within_its_deviation(scale: float) -> None:
    found, sd = climbed(scale, wander=0.15).scale
    assert found == pytest.approx(scale / (1 + scale), abs=2.5 * sd)
    assert sd < 0.08


def test_after_a_pause_the_offset_may_be_another_one() -> None:
    found = climbed(0.1, flights=2, gap=60.0)
    assert found.scale[0] == pytest.approx(0.1 / 1.1, abs=0.06)


def rise_and_sink(time: float) -> float:
    """A take-off, a hold, a descent: 0.7 m to 2.1 m and back."""
    return 0.7 + 1.4 * float(np.clip(min(time - 1.0, 7.0 - time) / 2.3, 0.0, 1.0))


def test_a_focal_length_wrong_by_a_quarter_is_told_and_then_sure() -> None:
    once = climbed(0.25, height=rise_and_sink, wander=0.08)
    assert once.contradicts
    assert climbed(0.25, height=rise_and_sink, wander=0.08, flights=3).odds > HEIGHTS_SURE
    assert once.scale[0] == pytest.approx(0.2, abs=2.5 * once.scale[1])

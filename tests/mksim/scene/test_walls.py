"""Walls in a rendered scene: tags on them are posed, what is behind them is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyapriltags
import pytest

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import TagPlacement, TargetSection, VisionSection
from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.vision import VisionPose
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.tags.tagmap import build
from mksim.config import SceneConfig, WallConfig
from mksim.scene.camera import BodyState, SceneCamera
from mksim.scene.light import CLEAN
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, true_corners
from mksim.scene.view import project, view_towards
from mksim.scene.walls import wall_surfaces

from .edges import corner_errors

PINHOLE = Intrinsics(width=640, height=480, fx=500, fy=500, cx=319.5, cy=239.5)
NORTH = WallConfig(start=(-1.5, 2.0), end=(1.5, 2.0))
"""Its front faces south."""
BEFORE = WallConfig(start=(-0.4, 1.2), end=(0.4, 1.2), height=1.8, surface="asphalt")
"""Between the middle of the room and `NORTH`."""
FACING_SOUTH = (90.0, 0.0, 0.0)
HANGING = tuple(
    TagPlacement(id=number, size=0.25, position=(east, 2.0, up), rpy_deg=FACING_SOUTH)
    for number, (east, up) in enumerate(((-0.9, 0.9), (0.0, 1.5), (0.9, 1.0)), 20)
)
LYING = TagPlacement(id=30, size=0.25, position=(0.0, 0.4, 0.0))
BEHIND = TagPlacement(id=31, size=0.25, position=(0.0, 2.8, 0.0))
STEP = TagPlacement(id=32, size=0.2, position=(-0.9, 1.4, 0.3))


def room(*tags):
    return build([TargetSection(name="room", tags=tags)], origin="test")


def scene(walls, *tags, seed=3):
    targets = [SceneTarget.of(target, Platform()) for target in room(*tags).targets]
    return Scene(targets, seed=seed, ground="tiles", walls=wall_surfaces(walls, seed))


def looking(place=(0.0, -1.6, 1.6), at=(0.0, 1.4, 0.6), **more):
    return view_towards(PINHOLE, np.array(place), np.array(at), **more)


def seen(image):
    found = pyapriltags.Detector(families="tag36h11", quad_decimate=1.0).detect(image)
    return {tag.tag_id: tag.corners[[3, 2, 1, 0]] - 0.5 for tag in found}


def test_raised_tags_are_where_the_exact_projection_says():
    made = scene([NORTH], *HANGING, STEP, LYING)
    view = looking()
    image = made.render(view, CLEAN)
    assert set(seen(image)) == {20, 21, 22, 30, 32}
    for tag in made.targets[0].target.tags:
        errors = corner_errors(image, tag, made.targets[0].motion.pose_at(0.0), view)
        assert errors.max() < (0.05 if tag.tag_id in (20, 21, 22) else 0.3), (tag.code, errors)


def test_a_wall_hides_what_is_behind_it_and_nothing_else():
    view = looking()
    assert set(seen(scene([NORTH, BEFORE], *HANGING, STEP, LYING, BEHIND).render(view, CLEAN))) == {20, 22, 30, 32}
    with_tag, without = (scene([NORTH], *HANGING, *more).render(view, CLEAN) for more in ((BEHIND,), ()))
    assert np.array_equal(with_tag, without)
    over = looking((0.0, 1.7, 5.0), (0.0, 2.6, 0.0))
    assert 31 in seen(scene([NORTH], LYING, BEHIND).render(over, CLEAN))


def test_a_rolling_shutter_bends_what_hangs_on_a_wall_by_its_own_depth():
    made = scene([NORTH], *HANGING)
    still = looking()
    view = replace(still, velocity_enu=np.array([2.0, 0.0, 0.0]), line_time=60e-6)
    found = seen(made.render(view, CLEAN))
    assert set(found) == {20, 21, 22}
    for tag in made.targets[0].target.tags:
        expected = []
        for corner in tag.corners:
            row = PINHOLE.cy
            for _ in range(5):
                moved = view.moved((row - PINHOLE.cy) * view.line_time)
                pixel = project(moved.camera_points(corner[None]), PINHOLE)[0]
                row = pixel[1]
            expected.append(pixel)
        off = np.array(expected) - true_corners(made.targets[0], still)[tag.code]
        assert np.abs(found[tag.tag_id] - np.array(expected)).max() < 0.4
        assert np.abs(off).max() > 1.0, "it would be seen without"


def test_the_eyes_pose_the_aircraft_by_tags_on_a_wall(tmp_path):
    lens = tmp_path / "ahead.toml"
    lens.write_text(
        'name = "ahead"\n[intrinsics]\nwidth = 640\nheight = 480\nfx = 425.0\nfy = 425.0\ncx = 319.5\ncy = 239.5\n'
        'k1 = -0.12\nk2 = 0.02\nline_time = 0.0\n[mount]\nposition_flu = [0.1, 0.0, 0.0]\nlooks = "forward"\n'
    )
    tagmap = room(*HANGING)
    camera = SceneCamera(SceneConfig(camera=lens), 1, tagmap, walls=[NORTH])
    eyes = CameraPipeline(CameraSection(source="x"), VisionSection(), Clock(), camera=camera.camera, tagmap=tagmap)
    place = np.array([0.2, -0.3, 1.1])
    values = []
    for number in range(3):
        at = number / 30
        state = BodyState(at, place, np.zeros(3), rotation_from_euler(0.0, 0.05, np.pi / 2), np.zeros(3))
        image = CameraImage(camera.expose(state), 10.0 + at, 10.0 + at, number, "ahead")
        values += [value for _, value in eyes.process(image, None) if isinstance(value, VisionPose)]
    assert values
    assert values[-1].position_target == pytest.approx(place, abs=0.02)

"""Families of tags: bitmaps against libapriltag, and those with data outside their border from print to pose."""

from __future__ import annotations

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from lab.vision.stills import error_of
from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.vision.calibrate.target_print import svg, target_page
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import CellReader
from mkdaemon.vision.pose.pose import solve
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags import tagfamily
from mkdaemon.vision.tags.detector import Detector, library_of
from mkdaemon.vision.tags.tagfamily import FAMILIES, TagFamily, cells, find_family
from mkdaemon.vision.tags.tagmap import TagMap, Target, build, single
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target, true_corners
from tests.vision.calibrate.test_target_print import PX_PER_MM, paint_svg
from tests.vision.views import VGA, place, printed


def distance(family: TagFamily) -> int:
    """Smallest Hamming distance between two codes, which the name ends with."""
    return int(family.name.rpartition("h")[2])


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_libapriltag_reads_every_print_upright(family):
    lib = library_of((family.name,))
    for tag_id in {0, 1, family.ids // 2, family.ids - 1}:
        found = lib.detect(printed(cells(family.name, tag_id)))
        assert [(item.tag_id, item.hamming) for item in found] == [(tag_id, 0)]
        # Upright: the homography's axes point right and down in the image.
        assert found[0].homography[0, 0] / found[0].homography[2, 2] > 0
        assert found[0].homography[1, 1] / found[0].homography[2, 2] > 0


@pytest.mark.parametrize(
    ("family", "tag_id", "words"),
    [
        ("tag36h12", 0, "tag36h11"),
        ("tag36h11", 587, "0 to 586"),
        ("tag16h5", -1, "0 to 29"),
        ("tagCircle21h7", 38, "0 to 37"),
    ],
)
def test_unknown_tags_are_named_with_the_fix(family, tag_id, words):
    with pytest.raises(VisionError, match=words):
        cells(family, tag_id)
    assert find_family("tag36h11").black_cells == 8


WIDTH = 0.3
"""Of everything black [m]."""


def target_of(name: str, tag_id: int = 7) -> Target:
    family = FAMILIES[name]
    return single(WIDTH * family.size_cells / family.black_cells, tag_id, family=name)


def build_tags(*tags: TagPlacement) -> TagMap:
    return build([TargetSection(name="pad", tags=tags)], origin="test")


@pytest.mark.parametrize("name", ["tagStandard41h12", "tagCustom48h12"])
def test_a_rendered_tag_is_found_with_its_corners_and_posed(name):
    target = target_of(name)
    placed = SceneTarget.of(target, Platform())
    scene = Scene([placed], ground=None, seed=3, fine=False)
    sources = set()
    for k, (distance, tilt) in enumerate(((0.9, 0.5), (5.5, 0.4))):
        view = place(distance, tilt, roll=0.7 * k)
        pixels = scene.render(view)
        tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
        results = [tracker.update(CameraImage(pixels, t, t, n, "test", "driver")) for n, t in enumerate((0.0, 0.1))]
        [found] = next(result.detections for result in results if result.detections)
        true = true_corners(placed, view)[name, 7]
        assert (found.family, found.tag_id, found.hamming) == (name, 7, 0)
        assert np.abs(found.corners - true).max() < (0.3 if distance < 3.0 else 0.8)
        starts = solve([(target.tags[0], found)], Projection(VGA))
        fitted = TargetFitter(target, Projection(VGA)).cold(pixels, starts)
        rotation, position = cam_from_target(placed, view)
        errors = [error_of(pose.rotation, pose.position, rotation, position) for pose in fitted]
        best = min(errors, key=lambda error: error.angle_deg)
        assert best.distance < 0.003 * distance
        assert best.angle_deg < 1.0
        sources |= {pose.source for pose in fitted}
        if distance < 3.0:
            [published] = next(result.poses for result in results if result.poses)
            assert not error_of(published.pose.rotation, published.pose.position, rotation, position).is_wrong
            assert CellReader(target, Projection(VGA)).evidence(pixels, published.pose).is_clear
    assert sources == {"edges", "photometric"}


@pytest.mark.parametrize("name", ["tagStandard41h12", "tagCircle21h7"])
def test_a_printed_tag_is_read_back_in_its_true_size(name):
    target = target_of(name, 5)
    text = svg(target_page(target))
    assert "side of the white square inside the black ring" in text
    [found] = Detector({name: frozenset({5})}).search_all(paint_svg(text))
    sides = np.linalg.norm(found.corners - np.roll(found.corners, 1, axis=0), axis=1) / PX_PER_MM
    assert sides == pytest.approx(np.full(4, 1000 * target.tags[0].size), abs=0.15)
    # Upright: top-left first, top-right to its right.
    assert found.corners[1, 0] - found.corners[0, 0] > 10 * abs(found.corners[1, 1] - found.corners[0, 1])


def test_families_are_searched_together_and_each_has_its_own_whitelist():
    side_by_side = [
        np.pad(printed(tagfamily.cells(name, 5), 12, 2), 4, constant_values=255)
        for name in ("tag36h11", "tagStandard41h12", "tagCircle21h7")
    ]
    height = max(len(one) for one in side_by_side)
    image = np.hstack([np.pad(one, ((0, height - len(one)), (0, 0)), constant_values=255) for one in side_by_side])
    allowed = {"tag36h11": frozenset({5}), "tagStandard41h12": frozenset({5}), "tagCircle21h7": frozenset({4})}
    seen = {(found.family, found.tag_id) for found in Detector(allowed).search_all(image)}
    assert seen == {("tag36h11", 5), ("tagStandard41h12", 5)}


def test_a_hole_has_room_for_a_tag_and_data_have_not():
    hole = TagPlacement(family="tagCustom48h12", id=1, size=0.18)
    inside = TagPlacement(id=1, size=0.04)
    pad = build_tags(hole, inside)
    assert [tag.tag_id for tag in pad.targets[0].tags] == [1, 1]
    scene = Scene([SceneTarget.of(pad.targets[0], Platform())], ground=None, seed=1, fine=False)
    seen = Detector(pad.whitelist).search(scene.render(place(0.5, 0.2)), "grey")
    assert {found.family for found in seen} == {"tagCustom48h12", "tag36h11"}
    with pytest.raises(ConfigError, match="covers the border of tag 1"):
        build_tags(TagPlacement(family="tagStandard52h13", id=1, size=0.18), inside)


def test_no_print_of_opencv_is_taken_for_one_of_them():
    with pytest.raises(ConfigError, match="OpenCV cannot draw tagCircle21h7"):
        build_tags(TagPlacement(family="tagCircle21h7", id=0, size=0.1, print="opencv"))

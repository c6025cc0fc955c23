"""What a stranger's value says, and which values count as images: poses, refusals and tags from any source."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mkdaemon.view.report.baseline import NO_TAG, OTHER_TAGS
from mkdaemon.view.report.said import number_of
from mkdaemon.view.report.sights import MOST_IMAGES, Sights
from tests.view.report.compared import pose_fields, truth

RATE = 20.0


def pose(number, target="pad", **fields):
    place, turn = truth(1.0)
    return pose_fields("down", number, place, turn, target) | fields


def seen(*numbers):
    """A camera that posed images of these numbers, at 20 Hz."""
    sights = Sights()
    for number in numbers:
        sights.take_pose(number / RATE, pose(number))
    return sights


def test_values_of_one_image_are_one_outcome():
    sights = seen(1, 4)
    for number, at in ((1, 0.05), (2, 0.1), (3, 0.15)):
        sights.take_tags(at, {"sequence": number})
    sights.take_refused(0.1, {"sequence": 2, "target": "pad", "refusal": "bits"})
    sights.take_refused(0.15, {"sequence": 3, "target": "other", "refusal": "bits"})
    images = sights.images("pad")
    assert images.outcomes == ["", "bits", OTHER_TAGS, ""]
    assert images.times == pytest.approx([0.05, 0.1, 0.15, 0.2])


def test_numbers_that_are_missing_are_images_without_a_tag_and_a_camera_that_starts_again_counts_anew():
    images = seen(1, 2, 6).images("pad")
    assert images.outcomes == ["", "", NO_TAG, NO_TAG, NO_TAG, ""]
    assert images.times == pytest.approx(np.arange(1, 7) / RATE)
    assert images.weights.tolist() == [1.0] * 6
    sights = seen(1, 2, 3)
    for number in (1, 2, 4):
        sights.take_pose(10.0 + number / RATE, pose(number))
    assert sights.images("pad").outcomes == ["", "", "", "", "", NO_TAG, ""]


def test_a_source_misses_no_report_and_images_that_were_dropped_before_the_eyes_count_less():
    sights = Sights()
    for number in (1, 4, 7):
        sights.take_pose(number / 100.0, pose(number, source="report"))
    assert sights.images("pad").outcomes == ["", "", ""]
    sights = seen(1, 6)
    for dropped, lost in ((5, 0), (6, 1), (6, 2)):
        sights.take_stats(0.0, {"dropped": dropped, "lost": lost})
    assert sights.images("pad").weights.tolist() == pytest.approx([1.0, 0.25, 0.25, 0.25, 0.25, 1.0])


@pytest.mark.parametrize(("last", "posed"), [(10**11, 4), (2**63, 3)])
def test_a_number_that_no_camera_reaches_adds_no_images(last, posed):
    sights = seen(1, 2)
    for at, number in ((3600.0, last), (1e9, 3 * MOST_IMAGES)):
        sights.take_pose(at, pose(number))
    assert len(sights.images("pad").outcomes) == posed


@pytest.mark.parametrize(
    "fields",
    [
        {"position_target": [0.0, 1.0]},
        {"position_target": [0.0, 1e6, 0.0]},
        {"position_target": [0.0, math.nan, 0.0]},
        {"quaternion_target_from_flu": [0.0, 0.0, 0.0, 0.0]},
        {"quaternion_target_from_flu": "north"},
        {"sequence": None},
    ],
)
def test_what_is_no_pose_is_left_out(fields):
    sights = seen(1)
    sights.take_pose(0.1, pose(2, **fields))
    assert len(sights.track("pad").times) == 1
    assert sights.track("deck").positions.shape == (0, 3)


def test_a_setup_says_where_tags_and_lens_are():
    sights = Sights()
    corners = [[2.0, 0.1, 1.1], [2.0, -0.1, 1.1], [2.0, -0.1, 0.9], [2.0, 0.1, 0.9]]
    lens = {"fx": 400.0, "fy": 410.0, "cx": 320.0, "cy": 240.0, "width": 640, "height": 480, "model": "pinhole"}
    mounted = {"position_flu": [0.1, 0.0, 0.0], "quaternion_flu_from_cam": [1.0, 0.0, 0.0, 0.0]}
    sights.take_setup(0.0, {"lens": lens, "targets": [{"name": "wall", "tags": [{"corners": corners}]}], **mounted})
    view = sights.sight("wall")
    assert view.centres == pytest.approx(np.array([[2.0, 0.0, 1.0]]))
    assert view.normals == pytest.approx(np.array([[-1.0, 0.0, 0.0]]))
    assert view.radii == pytest.approx([math.hypot(0.1, 0.1)])
    assert (view.arm.tolist(), view.lens.tolist()) == ([0.1, 0, 0], [400, 410, 320, 240, 640, 480])
    for broken in ({"lens": None}, {"quaternion_flu_from_cam": None}):
        sights.take_setup(1.0, {"lens": lens, **mounted} | broken)
        assert sights.sight("wall").lens is None
    assert sights.sight("wall").normals.tolist() == [[0.0, 0.0, 1.0]]


FIELDS = {
    "a": 1.5, "b": {"c": [1, 2.5, -3]}, "nan": float("nan"), "inf": float("inf"), "huge": 1e300, "big": 10**400,
    "yes": True, "word": "w", "bytes": b"\x00", "none": None, "long": "x" * 999,
}  # fmt: skip


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("a", 1.5), ("b.c.1", 2.5), ("b.c.3", None), ("b.c.x", None), ("b.c.-1", None), ("b", None), ("a.b", None),
        ("nan", None), ("inf", None), ("huge", None), ("big", None), ("yes", None), ("word", None), ("none", None),
        ("", None), ("word.0", None),
    ],
)  # fmt: skip
def test_only_finite_numbers_of_a_likely_size_are_numbers(path, expected):
    assert number_of(FIELDS, path) == expected
    assert number_of(None, path) is None

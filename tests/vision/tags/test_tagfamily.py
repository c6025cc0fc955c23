"""Bitmaps against libapriltag: the official orientation, and the trap of OpenCV's."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pyapriltags
import pytest

from mkdaemon.errors import VisionError
from mkdaemon.vision.tags.detector import library_of
from mkdaemon.vision.tags.tagfamily import FAMILIES, TagFamily, cells, find_family
from tests.vision.views import printed

DICTIONARIES = {
    "tag36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "tag25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "tag16h5": cv2.aruco.DICT_APRILTAG_16h5,
}
"""OpenCV's, of the classic families."""
CLASSIC = [family for family in FAMILIES.values() if not family.is_inverted]
INVERTED = [family for family in FAMILIES.values() if family.is_inverted]


def distance(family: TagFamily) -> int:
    """Smallest Hamming distance between two codes, which the name ends with."""
    return int(family.name.rpartition("h")[2])


def test_the_table_holds_all_families_of_the_wheel_as_the_library_has_them():
    library = pyapriltags.Detector(families="")
    assert set(FAMILIES) == set(library._SUPPORTED_FAMILIES)
    for family in FAMILIES.values():
        there = getattr(library.libc, f"{family.name}_create")().contents
        assert (there.ncodes, there.nbits, there.h) == (family.ids, family.bits, distance(family))
        assert (there.width_at_border, there.reversed_border) == (family.size_cells, family.is_inverted)
        assert there.total_width == family.black_cells + (0 if family.is_inverted else 2)


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_tables_of_flipped_codes_stay_small(family):
    listed = [family.ids * sum(math.comb(family.bits, k) for k in range(bits + 1)) for bits in range(4)]
    assert listed[family.corrected_bits] <= 1_000_000
    assert family.corrected_bits == 2 or listed[family.corrected_bits + 1] > 1_000_000
    assert (family.corrected_bits == 2) == (family.ids < 1000)


@pytest.mark.parametrize("family", INVERTED, ids=lambda family: family.name)
def test_inverted_prints_have_a_white_square_in_a_black_ring(family):
    bitmap = cells(family.name, family.ids // 3) > 0
    assert bitmap.shape == (family.black_cells, family.black_cells)
    first = (family.black_cells - family.size_cells) // 2
    last = first + family.size_cells - 1
    for ring, is_white in (((first, last), True), ((first - 1, last + 1), False)):
        a, b = ring
        for side in (bitmap[a, a : b + 1], bitmap[b, a : b + 1], bitmap[a : b + 1, a], bitmap[a : b + 1, b]):
            assert bool(side.all() if is_white else not side.any())
    assert bool(bitmap[[0, 0, -1, -1], [0, -1, 0, -1]].all()) or "Circle" not in family.name


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_libapriltag_reads_every_print_upright(family):
    lib = library_of((family.name,))
    for tag_id in {0, 1, family.ids // 2, family.ids - 1}:
        found = lib.detect(printed(cells(family.name, tag_id)))
        assert [(item.tag_id, item.hamming) for item in found] == [(tag_id, 0)]
        # Upright: the homography's axes point right and down in the image.
        assert found[0].homography[0, 0] / found[0].homography[2, 2] > 0
        assert found[0].homography[1, 1] / found[0].homography[2, 2] > 0


@pytest.mark.parametrize("family", CLASSIC, ids=lambda family: family.name)
def test_opencv_draws_the_same_codes_upside_down(family):
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[family.name])
    assert dictionary.bytesList.shape[0] == family.ids
    for tag_id in range(family.ids):
        drawn = cv2.aruco.generateImageMarker(dictionary, tag_id, family.black_cells)
        assert np.array_equal(cells(family.name, tag_id), np.rot90(drawn, 2))


def test_bitmaps_have_a_black_border_and_their_distance():
    for family in CLASSIC:
        bitmaps = [cells(family.name, k) > 0 for k in range(0, family.ids, 7)]
        for bitmap in bitmaps:
            assert not bitmap[[0, -1]].any()
            assert not bitmap[:, [0, -1]].any()
        apart = [
            int((a != np.rot90(b, turns)).sum())
            for k, a in enumerate(bitmaps[:12])
            for b in bitmaps[k + 1 : 12]
            for turns in range(4)
        ]
        assert not apart or min(apart) >= distance(family)


def test_bitmaps_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        cells("tag36h11", 0)[0, 0] = 255


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

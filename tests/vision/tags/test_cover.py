"""Cells of a large tag that a smaller one lies on say nothing where light spreads white."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mkdaemon.vision.tags.cellread import CodeReader
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.outline import read_outlines
from mkdaemon.vision.tags.tagfamily import cells
from mkdaemon.vision.tags.tagmap import TagMap, covered_cells
from tests.vision.views import printed, shipped

CODE = ("tag36h11", 48)
MIDDLE = (slice(3, 5), slice(3, 5))


def flooded(pixels_per_cell: int) -> np.ndarray:
    """The outer tag of the nested target, its four middle cells as white as the inner tag's paper."""
    drawn = cells(*CODE).copy()
    assert not drawn[MIDDLE].any()
    drawn[MIDDLE] = 255
    return printed(drawn, pixels_per_cell)


@pytest.mark.parametrize("name", ["nested", "nested-36"])
def test_the_inner_tag_covers_the_middle_of_the_outer_one(name: str) -> None:
    outer, inner = shipped(name).tags
    covered = covered_cells(TagMap((shipped(name),)))
    assert not covered[inner.code].any()
    under = covered[outer.code]
    assert under[MIDDLE].all()
    assert under.sum() == 4


def test_a_tag_alone_is_covered_by_nothing() -> None:
    assert not any(under.any() for under in covered_cells(TagMap((shipped("single"),))).values())


def test_covered_cells_are_not_read() -> None:
    tags = TagMap((shipped("nested"),))
    whole, blind = (CodeReader(tags.whitelist, covered) for covered in ({}, covered_cells(tags)))
    assert read_outlines(flooded(20), whole) == []
    [found] = read_outlines(flooded(20), blind)
    assert (found.family, found.tag_id, found.hamming) == (*CODE, 0)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_a_nested_target_in_a_highlight_is_found(turns: int) -> None:
    """Ink of 150 to 238 beside paper that is blown, on dark ground; light spreads over the middle."""
    print_ = np.pad(flooded(5), 40, constant_values=0).astype(np.float64)
    ink = np.linspace(150.0, 238.0, print_.shape[1])[None, :]
    ground = np.zeros(print_.shape, bool)
    ground[:40], ground[-40:], ground[:, :40], ground[:, -40:] = True, True, True, True
    lit = np.where(ground, 30.0, np.where(print_ > 0, 255.0, ink))
    image = np.rot90(cv2.GaussianBlur(lit, (0, 0), 0.7), turns).round().astype(np.uint8)
    tags = TagMap((shipped("nested"),))
    detector = Detector(tags.whitelist, covered=covered_cells(tags))
    assert [found.tag_id for found in detector.search(np.ascontiguousarray(image), "outline")] == [48]

"""The campaign of targets that leave the image: what it shows, and that each wrong pose and fault has its place."""

from __future__ import annotations

import pytest

from lab.vision import leaving, looks
from lab.vision.leaving import LEAVING, WAY_OUT
from lab.vision.parts import Part
from mkdaemon.vision.track.tracker import Tracker


def left(name, camera, count):
    part = Part(leaving._leave, (name, camera, count, 3, 0), count)
    return LEAVING.sum_up(True, [part], [part.run()])[f"{name}_{camera}"]


def test_a_target_goes_over_the_border_and_what_is_wrong_is_counted_with_its_place(monkeypatch) -> None:
    monkeypatch.setattr(looks, "WRONG_DEG", -1.0)
    whole = left("nested", "global", 8)
    assert (whole["images"], whole["faults"]) == (8, 0)
    assert 0 < whole["wrong"] == whole["posed"] < 8
    assert whole["first_places"][0].startswith("nested global seed 3 part 0 image 0: 0.0")


@pytest.mark.parametrize("camera", leaving.CAMERAS)
def test_a_fault_is_counted_with_its_place_and_the_next_image_is_looked_at(monkeypatch, camera) -> None:
    def fails(*_given: object) -> None:
        raise IndexError("of nothing")

    monkeypatch.setattr(Tracker, "update", fails)
    whole = left("single", camera, 4)
    assert (whole["faults"], whole["images"]) == (len(WAY_OUT), 0)
    assert "seed 3 part 0 image 0: IndexError('of nothing')" in whole["first_places"][0]

"""The campaign of targets that leave the image: what it shows, and that each wrong pose and fault has its place."""

from __future__ import annotations

import pytest

from lab.vision import leaving, looks
from lab.vision.leaving import WAY_OUT, summary
from mkdaemon.vision.track.tracker import Tracker


def test_a_target_goes_over_the_border_and_is_posed_while_it_is_in_view() -> None:
    figures = summary(leaving._leave("nested", "global", 8, 3, 0))
    assert (figures["images"], figures["faults"]) == (8, 0)
    posed = figures["posed_by_way_out"]
    assert list(posed) == [str(way) for way in WAY_OUT]
    assert posed[str(WAY_OUT[0])] >= posed[str(WAY_OUT[-1])]


def test_what_is_wrong_is_counted_with_its_place(monkeypatch) -> None:
    monkeypatch.setattr(looks, "WRONG_DEG", -1.0)
    whole = summary(leaving._leave("nested", "global", 4, 3, 0))
    assert whole["wrong"] == whole["published"] > 0
    assert whole["first_wrong"][0].startswith("nested global seed 3 part 0 image 0: 0.0")


@pytest.mark.parametrize("camera", leaving.CAMERAS)
def test_a_fault_is_counted_with_its_place_and_the_next_image_is_looked_at(monkeypatch, camera) -> None:
    def fails(*_given: object) -> None:
        raise IndexError("of nothing")

    monkeypatch.setattr(Tracker, "update", fails)
    whole = summary(leaving._leave("single", camera, 4, 3, 0))
    assert whole["faults"] == whole["images"] == len(WAY_OUT)
    assert "seed 3 part 0 image 0: IndexError('of nothing')" in whole["first_faults"][0]

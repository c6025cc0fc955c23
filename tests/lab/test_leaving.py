"""The campaign of targets that leave the image: what it shows, and that each wrong pose and fault has its place."""

from __future__ import annotations

import pytest

from lab.vision import leaving, looks
from lab.vision.leaving import WAY_OUT, Tally
from mkdaemon.vision.track.tracker import Tracker


def test_a_target_goes_over_the_border_and_is_posed_while_it_is_in_view() -> None:
    tally = leaving._leave("nested", "global", 8, 3, 0)
    assert tally.images == dict.fromkeys(WAY_OUT, 2)
    assert not tally.faults
    assert tally.posed[WAY_OUT[0]] >= tally.posed[WAY_OUT[-1]]


def test_what_is_wrong_is_counted_with_its_place(monkeypatch) -> None:
    monkeypatch.setattr(looks, "WRONG_DEG", -1.0)
    whole = leaving._leave("nested", "global", 4, 3, 0).summary()
    assert whole["wrong"] == whole["published"] > 0
    assert whole["first_wrong"][0].startswith("nested global seed 3 part 0 image 0: 0.0")


@pytest.mark.parametrize("camera", leaving.CAMERAS)
def test_a_fault_is_counted_with_its_place_and_the_next_image_is_looked_at(monkeypatch, camera) -> None:
    def fails(*_given: object) -> None:
        raise IndexError("of nothing")

    monkeypatch.setattr(Tracker, "update", fails)
    whole = Tally.together([leaving._leave("single", camera, 4, 3, 0), Tally()]).summary()
    assert whole["faults"] == whole["images"] == len(WAY_OUT)
    assert "seed 3 part 0 image 0: IndexError('of nothing')" in whole["first_faults"][0]

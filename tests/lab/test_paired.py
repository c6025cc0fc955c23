"""What is shown to two trees, and that each image is a row of its own."""

from __future__ import annotations

import pytest

from lab.vision.decks import LIES
from lab.vision.paired import Setting, looked_at, settings
from lab.vision.real import DEVICES
from lab.vision.weather import SKIES


def test_every_camera_hardship_and_deck_is_shown():
    shown = settings(90_000_000)
    assert {setting.which for setting in shown} >= {*DEVICES, *SKIES, *LIES}
    assert sum(setting.images * 2 for setting in shown if setting.scene != "free") > 4_600


@pytest.mark.parametrize("which", ["rolling", "fringe", "roll_sign_swapped"])
def test_a_setting_has_its_lens_and_its_attitude(which):
    scene = {"rolling": "cameras", "fringe": "hardships", "roll_sign_swapped": "decks"}[which]
    setting = Setting(scene, "nested", which, 23_000_001, 1)
    assert (setting.lens.line_time > 0) == (which == "rolling")
    (view,) = setting.views()
    assert view.image.pixels.any()
    if which == "roll_sign_swapped":
        plain = next(Setting("decks", "nested", "level", 23_000_001, 1).views()).attitude.samples
        assert [s.roll for s in view.attitude.samples] == [-s.roll for s in plain]


@pytest.mark.parametrize(("scene", "which", "ending"), [("steep", 75.0, "finished"), ("free", "asphalt", "refused")])
def test_every_image_is_a_row_with_attitude_and_without(scene, which, ending):
    rows = looked_at(Setting(scene, "single", which, 90_000_950, 1))
    assert [key["knows"] for key, _ in rows] == [True, False]
    assert [row["ending"] for _, row in rows] == [ending] * 2

"""Two trees on the same images: what is shown, and how it is compared image by image."""

from __future__ import annotations

import pytest

from lab.vision.decks import LIES
from lab.vision.paired import compare, scenes
from lab.vision.pairedscenes import Setting, views
from lab.vision.real import DEVICES
from lab.vision.weather import SKIES


def looked(posed: str, wrong: int = 0) -> list[dict[str, object]]:
    return [{"posed": mark == "x", "wrong": k < wrong, "ms": [10.0], "refused": ""} for k, mark in enumerate(posed)]


def test_images_are_compared_one_by_one():
    table = compare({"flights nested with": looked("xx..x")}, {"flights nested with": looked("xxx..", wrong=1)})
    row = next(line for line in table.splitlines() if line.startswith("flights nested with"))
    assert row.split()[3:] == ["5", "3", "3", "-1", "+1", "0", "->", "1", "0.00", "->", "0.00"]


def test_every_camera_hardship_and_deck_is_shown():
    shown = {part for scene in scenes(90_000_000) for part in scene.name.split()}
    assert shown >= {*DEVICES, *SKIES, *LIES}


@pytest.mark.parametrize("which", ["rolling", "fringe", "roll_sign_swapped"])
def test_a_setting_has_its_lens_and_its_attitude(which):
    scene = {"rolling": "cameras", "fringe": "hardships", "roll_sign_swapped": "decks"}[which]
    setting = Setting(scene, "nested", which, 23_000_001, 0, 1)
    assert (setting.lens.line_time > 0) == (which == "rolling")
    (view,) = views(setting)
    assert view.image.pixels.any()
    if which == "roll_sign_swapped":
        plain = next(views(Setting("decks", "nested", "level", 23_000_001, 0, 1))).attitude.samples
        assert [s.roll for s in view.attitude.samples] == [-s.roll for s in plain]

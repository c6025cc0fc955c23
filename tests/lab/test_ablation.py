"""The ablation's arithmetic: what is switched off, and how two trackers are compared image by image."""

from __future__ import annotations

import numpy as np
import pytest

from lab.campaign import Part
from lab.vision.ablation import Score, look, plan, run, table
from lab.vision.ablationscenes import SCENES, Setting, views
from lab.vision.decks import LIES
from lab.vision.real import DEVICES
from lab.vision.stills import SeedSet
from lab.vision.variants import VARIANTS, WHOLE, limits, variants_named, without_search
from lab.vision.weather import SKIES
from mkdaemon.errors import ConfigError
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.detector import Detector


def score(posed: str, wrong: int = 0) -> Score:
    flags = [mark == "x" for mark in posed]
    return Score(flags, [0.01] * sum(flags), [0.1] * sum(flags), wrong, 0.01 * len(flags))


def test_images_are_compared_one_by_one():
    against = score("xx..x").against(score("xxx.."))
    assert (against["lost"], against["won"]) == (1, 1)
    assert against["noise"] == round(2 * np.sqrt(2), 1)
    assert against["posed"] == 0.6
    assert against["ms"] == 10.0
    assert score("....").against(score("...."))["median_cm"] is None


def test_every_variant_switches_something_off_and_only_that():
    assert len({variant.name for variant in VARIANTS}) == len(VARIANTS)
    for variant in VARIANTS:
        handed = variant.tracker is not None, variant.detector is not None
        changed = variant.limits != WHOLE.limits, *handed, variant.is_flat
        assert sum(changed) == 1, variant.name


def test_a_search_is_left_out_of_the_whole_image_and_of_the_neighbourhood():
    left = without_search("log").search
    assert "log" not in left.ladder
    assert all("log" not in way for way in left.nearby)
    assert set(left.ladder) == set(LIMITS.search.ladder) - {"log"}


def test_limits_change_in_a_copy():
    changed = limits(read={"saturated": 256})
    assert changed.read.saturated == 256
    assert LIMITS.read.saturated < 256


def test_quick_is_a_fraction_and_no_part_repeats():
    quick, full = plan(True, SeedSet.ABLATION), plan(False, SeedSet.ABLATION)
    assert sum(part.images for part in quick) < sum(part.images for part in full) / 4
    assert {part.args[0].scene for part in quick} == set(SCENES)
    keys = [part.args[:-1] for part in full]
    assert len(set(keys)) == len(keys)


def test_every_camera_hardship_and_deck_is_shown():
    shown = {part.args[0].which for part in plan(True, SeedSet.ABLATION)}
    assert shown >= {*DEVICES, *SKIES, *LIES}


@pytest.mark.parametrize("which", ["rolling", "fringe", "roll_sign_swapped"])
def test_a_setting_has_its_lens_and_its_attitude(which):
    scene = {"rolling": "cameras", "fringe": "hardships", "roll_sign_swapped": "decks"}[which]
    setting = Setting(scene, "nested", which, 23_000_001, 0, 2)
    scores = look(setting, ())
    assert [len(score.posed) for score in scores.values()] == [2, 2]
    assert (setting.lens.line_time > 0) == (which == "rolling")
    if which == "roll_sign_swapped":
        plain = next(views(Setting("decks", "nested", "level", 23_000_001, 0, 2))).attitude.samples
        assert [s.roll for s in next(views(setting)).attitude.samples] == [-s.roll for s in plain]


def test_first_images_are_far_apart_and_every_search_has_its_turn():
    first, second = views(Setting("met", "nested", "leaf_shadows", 23_000_001, 0, 2))
    assert second.image.captured_at - first.image.captured_at == pytest.approx(0.5)
    looks = Detector({"tag36h11": frozenset({1})}).looks(np.zeros((480, 640), np.uint8))
    assert first.looks == second.looks == LIMITS.search.thorough_every * len(looks)


def test_parts_are_chosen_by_name():
    assert [variant.name for variant in variants_named(["shift", "coast"])] == ["shift", "coast"]
    assert variants_named(None) is VARIANTS
    with pytest.raises(ConfigError, match="no such part"):
        variants_named(["wings"])


def test_the_table_has_a_line_for_every_variant(monkeypatch):
    part = Part(lambda *_: {}, (Setting("flights", "nested", "flights", 1, 0, 2),), 2)
    found = {
        (variant.name, known): score("xx" if variant is WHOLE else "x.")
        for variant in (WHOLE, *VARIANTS)
        for known in (True, False)
    }
    monkeypatch.setattr("lab.vision.ablation.plan", lambda *_: [part])
    monkeypatch.setattr("lab.vision.ablation.run_parts", lambda *_: [found])
    figures = run(True, SeedSet.ABLATION)
    lines = table(figures).splitlines()
    assert len(lines) == 3 + len(VARIANTS)
    assert "| 100.0 % | 100.0 % | 0.0 % | 0.0 % | 0 |" in lines[2]
    assert all("| -1 | -1 | 0 | 0 | 0 |" in line for line in lines[3:])

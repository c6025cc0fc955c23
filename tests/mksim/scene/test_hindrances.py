"""Fog, propellers, lamps and an analog link: what is left of the light behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.vision.flight import LEVEL, VGA
from lab.vision.stills import target_named
from mksim.scene.analogvideo import FIELD_TIME, AnalogVideo, through_air, weave
from mksim.scene.hindrances import (
    BLADE_SHADE,
    BLADES,
    Flicker,
    Fog,
    Propellers,
    add_fog,
    add_propellers,
    flickered,
)
from mksim.scene.light import CLEAN
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView, RayGrid, view_towards

RAYS = RayGrid(VGA)
EVEN = np.full((VGA.height, VGA.width), 0.5, dtype=np.float32)
ABOVE = view_towards(VGA, np.array([0.0, 0.0, 3.0]), np.zeros(3))


def test_fog_leaves_of_a_contrast_what_its_visibility_says():
    fog, ground = Fog(visibility=9.0, airlight=0.7), LEVEL.pose_at(0.0)
    dark, bright = (add_fog(np.full_like(EVEN, level), fog, ABOVE, RAYS, ground) for level in (0.0, 1.0))
    left = (bright - dark)[240, 320]
    assert left == pytest.approx(0.02 ** (3.0 / 9.0), rel=2e-3)
    assert dark[240, 320] == pytest.approx(0.7 * (1 - left), rel=1e-3)
    assert (bright - dark)[0, 0] < left, "the corner is farther away"
    level = view_towards(VGA, np.array([0.0, 0.0, 3.0]), np.array([0.0, 9.0, 3.0]))
    assert add_fog(EVEN, fog, level, RAYS, ground)[0, 320] == pytest.approx(0.7), "above the horizon there is fog alone"


def test_a_blade_that_turns_once_while_the_shutter_is_open_is_a_veil():
    blades = Propellers(rate=100.0, phase=(0.3, 1.0), width=0.2)
    seen = add_propellers(EVEN, blades, replace(ABOVE, exposure_time=1 / (BLADES * 100.0)))
    share = 0.2 * BLADES / (2 * np.pi)
    veiled = seen[:, :100][seen[:, :100] < 0.4999]
    assert veiled.size > 10_000
    assert veiled.max() - veiled.min() < 1e-5
    assert veiled[0] == pytest.approx(0.5 + share * (BLADE_SHADE - 0.5), rel=1e-4)


def test_lamps_make_bands_of_their_period_and_a_whole_period_none():
    flicker = Flicker(rate=200.0, depth=0.5)
    view = replace(ABOVE, line_time=50e-6, exposure_time=1e-4)
    rows = flickered(EVEN, flicker, view)[:, 0] / 0.5
    assert rows.max() == pytest.approx(1.5, abs=0.01) and rows.min() == pytest.approx(0.5, abs=0.01)
    assert np.allclose(rows[100:], rows[:-100], atol=1e-4), "1 / (200 Hz 50 us) rows"
    assert np.allclose(flickered(EVEN, flicker, replace(view, exposure_time=1 / 200.0)), EVEN, atol=1e-6)


def test_fields_of_a_moving_camera_make_combs_and_those_of_a_still_one_none():
    scene = Scene([SceneTarget.of(target_named("nested"), LEVEL)], ground=None, seed=1, fine=False)
    conditions = replace(CLEAN, analog=AnalogVideo(0.0, 0.0))
    shown = [scene.render(replace(ABOVE, velocity_enu=np.array([v, 0.0, 0.0])), conditions) for v in (0.0, 1.0)]
    rows = [image.astype(float) for image in shown]
    combs = [np.abs(2.0 * image[1:-1] - image[:-2] - image[2:]).mean() for image in rows]
    assert combs[1] > 3 * combs[0]
    places = [ABOVE.position_enu + np.array([side * FIELD_TIME / 2, 0.0, 0.0]) for side in (-1, 1)]
    fields = [scene.render(CameraView(VGA, ABOVE.enu_from_cam, place), CLEAN) for place in places]
    woven = weave(*(field.astype(np.float32) for field in fields))
    sent = through_air(woven, conditions.analog, np.random.default_rng(1))
    assert np.abs(sent - rows[1]).max() <= 1.5

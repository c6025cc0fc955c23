"""Edges of partly hidden targets bear out right poses and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.vision.pose.edgefit import EdgeEvidence, EdgeFit
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import VGA, View, angle_deg, assert_near, place, shipped, start_at

PROJECTION = Projection(VGA)


def strip(side: float, share: float, reflectance: float) -> LightConditions:
    """Something lying over the right side of a tag, its rim parallel to the border."""
    edge, far = side / 2 - share * side, side
    return LightConditions(covers=(Cover(((edge, -far), (far, -far), (far, far), (edge, far)), reflectance),))


@pytest.mark.parametrize(
    ("name", "reflectance", "share"), [("nested", 0.1, 0.3), ("nested", 0.7, 0.05), ("single", 0.3, 0.2)]
)
def test_a_right_pose_is_borne_out_behind_a_cover(name, reflectance, share):
    target = shipped(name)
    view = View(target, place(1.1, 0.35, around=1.0, roll=0.5), strip(target.tags[0].size, share, reflectance))
    fit = EdgeFit(target, PROJECTION)
    fitted = fit.fit(view.pixels, start_at(view, sd=1.0))
    assert_near(fitted, view, deg=0.5)
    assert fit.evidence(view.pixels, fitted).supports


def test_no_wrong_fit_is_borne_out():
    target, rng, wrong = shipped("single"), np.random.default_rng(5), 0
    fit = EdgeFit(target, PROJECTION)
    for k in range(24):
        cover = strip(target.tags[0].size, rng.uniform(0.03, 0.3), rng.uniform(0.05, 0.85))
        view = View(target, place(rng.uniform(0.8, 4.0), rng.uniform(0, 0.7), around=k, roll=k / 2), cover)
        off = turn(view.rotation, rng.normal(0, 0.25, 3))
        start = Pose(off, view.position * rng.uniform(0.92, 1.08), np.eye(6), "edges", 0, 0.0)
        fitted = fit.fit(view.pixels, start)
        if fitted is not None and angle_deg(fitted.rotation, view.rotation) >= 2.0:
            wrong += 1
            found = fit.evidence(view.pixels, fitted)
            assert not found.supports, (k, found)
    assert wrong >= 2


def test_nothing_is_borne_out_where_there_is_no_target():
    target = shipped("single")
    view, fit = View(target, place(1.0, 0.2)), EdgeFit(target, PROJECTION)
    pose = start_at(view, sd=1.0)
    assert not EdgeEvidence().supports
    assert fit.evidence(np.full((480, 640), 90, np.uint8), pose) == EdgeEvidence()
    noise = np.random.default_rng(1).integers(0, 255, (480, 640)).astype(np.uint8)
    assert not fit.evidence(noise, pose).supports
    assert fit.evidence(view.pixels, replace(pose, position=np.array([9.0, 0.0, 1.0]))) == EdgeEvidence()


def test_a_covered_target_is_posed_at_first_sight_without_attitude():
    target = shipped("nested")
    view = View(target, place(0.9, 0.4, around=2.0, roll=1.0), strip(target.tags[0].size, 0.2, 0.5))
    found = Tracker(TagMap((target,)), VGA, LOOKING_DOWN).update(view.image(), None).pose_of(target.name)
    assert_near(found.pose, view, m=0.01, deg=1.0)

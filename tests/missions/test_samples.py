"""The missions of configs/missions: read as `mkctl fly` reads them."""

from __future__ import annotations

import math

import pytest

from lab.places import ROOT
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.path.stored import StoredPaths
from mkdaemon.missions.script import (
    GotoStep,
    LandStep,
    PathStep,
    read_script,
)

SAMPLES = sorted((ROOT / "configs" / "missions").glob("*.toml"))
FENCE = AutopilotConfig()


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.stem)
def test_a_sample_is_read_and_stays_inside_the_fence(path):
    steps = read_script(path)
    assert isinstance(steps[-1], LandStep)
    places = [step.position for step in steps if isinstance(step, GotoStep) and step.frame == "pad"]
    for step in steps:
        if isinstance(step, PathStep):
            stored = StoredPaths(FENCE)
            places += stored.find(stored.upload(step.request, AircraftModel()).id).drawn
    assert places
    assert all(math.hypot(*place[:2]) < FENCE.fence_radius / 2 for place in places)
    assert all(FENCE.fence_floor < place[2] < FENCE.fence_height for place in places)

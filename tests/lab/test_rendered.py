"""Rendered images through the real eyes to the flight core, in virtual time."""

from __future__ import annotations

import numpy as np
import pytest

from lab.control.camera import CameraModel
from lab.control.flights import Flight
from lab.control.rendered import RenderedLandingRig, RenderedRig
from mkdaemon.telemetry.control import Phase


@pytest.mark.flight
def test_the_core_holds_over_a_target_that_the_eyes_see():
    rig = RenderedRig(Flight(seed=5, seconds=9.5, camera=CameraModel(rate=7.0)))
    rig.handover = 3.0
    record = rig.fly()
    assert not record.lost
    assert rig.core.phase is Phase.FLYING
    assert rig.posed >= 0.95 * rig.images
    errors = np.array(record.errors)[np.array(record.times) > 7.0]
    assert len(errors) > 100
    assert np.abs(errors).max() < 0.15


@pytest.mark.flight
def test_the_core_lands_on_a_target_that_the_eyes_see():
    rig = RenderedLandingRig(Flight(seed=5, seconds=30.0, land_at=6.0, camera=CameraModel(rate=7.0)))
    rig.handover = 3.0
    record = rig.fly()
    assert record.stands
    assert not record.lost
    assert record.touch_error < 0.15

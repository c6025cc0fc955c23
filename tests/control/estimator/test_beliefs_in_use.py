"""When the estimate changes its stick filter, and which tilt of an image it uses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.control.estimator.model import T
from tests.control.estimator.test_beliefs import MODEL, leaning_view, watched


def test_another_filter_is_changed_to_once():
    estimator = watched()
    estimator._response.has_other_filter = True
    for k in range(1, 4):
        estimator.attitude_received(0.02 * k, 0.0, 0.0, 0.0)
        assert estimator.model.stick_filter == MODEL.with_other_filter().stick_filter


@pytest.mark.parametrize(("sd", "is_used"), [(0.24, True), (0.26, False)])
def test_a_tilt_that_an_image_knows_worse_than_to_a_quarter_of_a_radian_is_not_used(sd, is_used):
    estimator = watched()
    seen = replace(leaning_view((0.1, 0.1, 0.0), (0.0, 0.0, 2.0)), covariance=np.diag([1e-4] * 3 + [sd**2] * 3))
    before = estimator._level.states[:, T].copy()
    estimator._see_tilt(seen, 1)
    assert bool(np.any(estimator._level.states[:, T] != before)) is is_used

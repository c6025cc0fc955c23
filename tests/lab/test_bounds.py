"""Cramer-Rao bounds: that the product's filters are near them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.vision.barometer import _fly
from lab.vision.bounds import mounting_sd, scale_sd
from lab.vision.flight import LOOKING_DOWN, VGA
from lab.vision.selfcal import ATTITUDE_SD, FPS, SECONDS, Descent
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.selfcal.selfcheck import MOUNTING, SIZES_AT, CameraFilter, ImageEvidence
from mkdaemon.vision.tags.tagmap import single

SEEDS = range(3_007_000, 3_007_060)


def test_the_scale_of_a_descent_is_as_good_as_a_barometer_allows() -> None:
    bound = scale_sd(Descent(0, yaws=False).height, SECONDS)
    assert bound == pytest.approx(0.052, abs=0.001)
    off = np.array([_fly(0.0, 1, seed).off for seed in SEEDS])
    assert np.sqrt((off**2).mean()) == pytest.approx(bound, rel=0.2)


def test_the_mounting_after_a_descent_is_as_good_as_the_attitude_allows() -> None:
    errors, claimed = zip(*(mounting_found(seed) for seed in SEEDS), strict=True)
    bound = float(np.mean([mounting_sd(Descent(seed, yaws=True).angles, SECONDS) for seed in SEEDS]))
    assert np.degrees(bound) == pytest.approx(0.23, abs=0.01)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(bound, rel=0.15)
    assert np.mean(claimed) == pytest.approx(bound, rel=0.1)


def mounting_found(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Error of roll and pitch, the attitude's own bias taken out, and their deviations [rad], by exact images."""
    descent, count = Descent(seed, yaws=True), SIZES_AT + 1
    rigid = replace(single(0.16, 7), bend=0.0)
    found = CameraFilter(rigid, Projection(VGA), ATTITUDE_SD, LOOKING_DOWN.flu_from_cam)
    information = np.diag([*[1e8] * 6, *[0.0] * count])
    for time in np.arange(0.5, SECONDS * FPS) / FPS:
        image = ImageEvidence(descent.view(float(time)).enu_from_cam.T, information, np.zeros(len(information)))
        found.image_seen(float(time), image, descent.attitude.at(float(time), 0.25))
    return found.mean[MOUNTING][:2] + descent.bias, found.sd[MOUNTING][:2]

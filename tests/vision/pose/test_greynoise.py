"""What residuals say about the noise of grey values."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.vision.pose.photofit import LEAST_SHARED, STREAK_PX, clarity, on_slopes, shared_by, streak_doubt

RNG = np.random.default_rng(5)


def test_a_pixel_counts_by_its_own_noise() -> None:
    value = np.tile([0.0, 1.0], 400)
    residual = RNG.standard_normal(800) * np.where(value > 0.5, 2.0, 8.0)
    clear = clarity(residual, value)
    assert clear[1] / clear[0] == pytest.approx(4.0, rel=0.2)
    assert float(np.mean(clear**2)) == pytest.approx(1.0)


def test_a_print_with_hardly_any_black_counts_evenly() -> None:
    value = np.concatenate([np.zeros(5), np.ones(200)])
    assert (clarity(RNG.standard_normal(205), value) == 1.0).all()


def test_independent_noise_is_shared_by_nobody() -> None:
    used = np.ones((60, 60), bool)
    factor, common = shared_by(RNG.standard_normal(3600), [used])
    assert factor < 1.1
    assert common < 0.05


def test_few_pixels_cannot_tell_that_they_share_nothing() -> None:
    used = np.ones((6, 6), bool)
    independent = np.indices((6, 6)).sum(axis=0) % 2 - 0.5  # neighbours are opposites
    assert shared_by(independent.ravel(), [used])[1] == pytest.approx(1.0 / 6.0)


def test_noise_that_neighbours_share_counts_more() -> None:
    used = np.ones((60, 60), bool)
    rough = RNG.standard_normal((61, 61))
    smooth = rough[1:, 1:] + rough[:-1, 1:] + rough[1:, :-1] + rough[:-1, :-1]
    # a correlation of one half each way
    factor, common = shared_by(smooth.ravel(), [used])
    assert factor == pytest.approx(1.5**2 / 0.5, rel=0.15)
    assert common == pytest.approx(0.5 / 0.7, rel=0.1)


def test_neighbours_that_sharpening_sets_against_each_other_tell_more() -> None:
    noise = np.random.default_rng(3).normal(size=(60, 60)).astype(np.float32)
    sharp = noise - 0.2 * (np.roll(noise, 1, 0) + np.roll(noise, 1, 1))
    used = np.ones(sharp.shape, dtype=bool)
    factor, common = shared_by(sharp[used].astype(np.float64), [used], LEAST_SHARED)
    assert factor < 0.75
    assert common <= 1.0 / 60.0
    assert shared_by(sharp[used].astype(np.float64), [used])[0] == 1.0


@pytest.mark.parametrize("larger", [1.0, 3.0])
def test_what_a_model_lacks_on_slopes_is_not_lost_among_even_paper(larger: float) -> None:
    """Nine tenths of the pixels are even, and hold the noise of the sensor alone."""
    used = np.ones((100, 100), bool)
    slopes = np.random.default_rng(4).random(used.size) < 0.1
    residual = np.random.default_rng(5).standard_normal(used.size) * np.where(slopes, larger, 1.0)
    weighed, told = on_slopes(residual, slopes.astype(np.float64))
    assert not weighed[~slopes].any()
    assert told * shared_by(weighed, [used])[0] == pytest.approx(larger**2 / np.mean(residual**2), rel=0.1)


@pytest.mark.parametrize(("length", "factor"), [(0.0, 1.0), (6.0, 1.0256), (STREAK_PX, 2.0), (2 * STREAK_PX, 17.0)])
def test_a_long_streak_is_believed_less_whichever_way_it_runs(length: float, factor: float) -> None:
    along = np.array([0.6, 0.8])
    spread = 1.5 * np.eye(2) + length**2 / 12.0 * np.outer(along, along)
    assert streak_doubt(spread) == pytest.approx(factor, rel=1e-3)

"""Wind classes by their statistics."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from mksim.config import WindClass
from mksim.physics.wind import CORRELATION_TIME, WIND_FIGURES, Wind

PERIOD = 0.02048


def blow(kind: WindClass, seconds: float, *, seed: int = 1, from_deg: float | None = 0.0) -> np.ndarray:
    wind = Wind(kind, rng=random.Random(seed), period=PERIOD, from_deg=from_deg)
    rows = []
    for k in range(round(seconds / PERIOD)):
        wind.update(k * PERIOD)
        rows.append((wind.east, wind.north, wind.up))
    return np.array(rows)


@pytest.mark.parametrize("kind", list(WindClass))
def test_mean_and_turbulence(kind: WindClass) -> None:
    figure = WIND_FIGURES[kind]
    rows = blow(kind, 2000.0)
    slack = 4.0 * figure.sd / math.sqrt(2000.0 / (2 * CORRELATION_TIME))
    assert rows[:, 0].mean() == pytest.approx(0.0, abs=slack + 1e-9)
    assert rows[:, 1].mean() == pytest.approx(-figure.mean, abs=slack + 1e-9), "wind from north blows south"
    assert rows[:, :2].std(axis=0) == pytest.approx([figure.sd] * 2, rel=0.15)
    assert rows[:, 2].std() == pytest.approx(0.5 * figure.sd, rel=0.15)


def test_a_gust_rises_and_goes_and_can_be_stopped() -> None:
    wind = Wind(WindClass.NONE, rng=random.Random(1), period=PERIOD)
    wind.start_gust(1.0, speed=4.0, from_deg=270.0, duration=2.0)
    seen = {}
    for t in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0):
        wind.update(t)
        seen[t] = wind.east
    assert seen == pytest.approx({1.0: 0.0, 1.5: 2.0, 2.0: 4.0, 2.5: 2.0, 3.0: 0.0, 4.0: 0.0}, abs=1e-9)
    wind.start_gust(5.0, speed=4.0, from_deg=0.0, duration=2.0)
    wind.update(6.0)
    assert wind.north == pytest.approx(-4.0)
    wind.stop_gust()
    wind.update(6.0)
    assert wind.north == 0.0

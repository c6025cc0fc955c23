"""Heights by the eyes against the barometer: the scale of a way, never of a hover."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mkdaemon.telemetry.selfcal import HEIGHTS_SURE
from mkdaemon.vision.selfcal.selfcheck import HeightFilter

DELAY = 0.1


def descend(time: float) -> float:
    return 4.0 - 3.0 * float(np.clip((time - 1.0) / 6.0, 0.0, 1.0))


def flown(
    scale: float, height: Callable[[float], float] = descend, wander: float = 0.0, flights: int = 1, gap: float = 0.0
) -> HeightFilter:
    found = HeightFilter()
    rng = np.random.default_rng(2)
    off, start = 0.0, 0.0
    for _ in range(flights):
        for k in range(240):
            time = k / 30
            off = 0.9967 * off + wander * 0.0816 * rng.standard_normal()
            if k % 6 == 0:
                reading = 7.0 + round((height(time - DELAY) + off) / 0.05) * 0.05
                found.reading_received(start + time - 0.005, reading)
            found.pose_seen(start + time, height(time) * (1 + scale) + 0.005 * rng.standard_normal())
        start += 8.0 + gap
    return found


@pytest.mark.parametrize("scale", [0.0, 0.2, -0.15])
def test_a_way_down_gives_the_scale_within_its_deviation(scale: float) -> None:
    found, sd = flown(scale, wander=0.15).scale
    assert found == pytest.approx(scale / (1 + scale), abs=2.5 * sd)
    assert sd < 0.08


def test_a_barometer_that_wanders_says_more_after_many_ways() -> None:
    once, often = (flown(0.05, wander=0.15, flights=n).scale[1] for n in (1, 12))
    assert often < 0.5 * once


def test_a_hover_says_nothing() -> None:
    found = flown(0.2, height=lambda _time: 2.0)
    assert found.scale[1] > 0.3
    assert found.covered < 0.05


def test_near_the_ground_the_rotors_press_on_the_barometer() -> None:
    assert flown(0.2, height=lambda time: 0.12 * descend(time)).covered == 0.0


def test_after_a_pause_the_offset_may_be_another_one() -> None:
    found = flown(0.1, flights=2, gap=60.0)
    assert found.scale[0] == pytest.approx(0.1 / 1.1, abs=0.06)


def test_images_that_are_missing_are_not_guessed() -> None:
    found = HeightFilter()
    for time, height in ((0.0, 4.0), (1.0, 3.0), (1.0, 3.0)):
        found.reading_received(time - 0.01, 9.0)
        found.pose_seen(time, height)
    assert found.covered == 0.0


def rise_and_sink(time: float) -> float:
    """A take-off, a hold, a descent: 0.7 m to 2.1 m and back."""
    return 0.7 + 1.4 * float(np.clip(min(time - 1.0, 7.0 - time) / 2.3, 0.0, 1.0))


def test_a_focal_length_wrong_by_a_quarter_is_told_and_then_sure() -> None:
    once = flown(0.25, height=rise_and_sink, wander=0.08)
    assert once.contradicts
    assert flown(0.25, height=rise_and_sink, wander=0.08, flights=3).odds > HEIGHTS_SURE
    assert once.scale[0] == pytest.approx(0.2, abs=2.5 * once.scale[1])


@pytest.mark.parametrize("flights", [1, 4])
def test_right_heights_are_likelier_right_than_wrong(flights: int) -> None:
    assert flown(0.0, height=rise_and_sink, wander=0.15, flights=flights).odds < 0.0


def test_a_barometer_that_does_not_move_says_nothing() -> None:
    found = HeightFilter()
    for k in range(240):
        found.reading_received(k / 30 - 0.005, 0.0)
        found.pose_seen(k / 30, descend(k / 30))
    assert found.covered > 2.0
    assert found.odds == 0.0

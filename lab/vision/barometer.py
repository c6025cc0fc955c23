"""What a barometer tells about the size of everything: descents from 4 m to 1 m, heights too large by some share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lab.vision.bounds import scale_sd
from lab.vision.descent import FPS, SECONDS, Descent
from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet
from mkdaemon.vision.selfcal.selfcheck import HeightFilter

PAUSE: Final = 60.0
"""From one descent of a flight to the next [s]."""
EYES_SD: Final = 0.001
"""Of one height by the eyes, share of it."""
FLIGHTS: Final = {(0.0, 1): 150, (0.02, 1): 60, (0.1, 1): 30, (0.2, 1): 30, (0.3, 1): 30, (0.0, 10): 15, (0.05, 10): 15}
"""How many, by the share that is wrong and the descents of a flight."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One flight: whether it was told, the error of the share found, and the deviation claimed."""

    told: bool
    off: float
    sd: float


def _fly(share: float, descents: int, seed: int) -> Outcome:
    heights, told = HeightFilter(), False
    rng = np.random.default_rng([seed, 0xBA80])
    for number in range(descents):
        descent, start = Descent(100 * seed + number, yaws=False), PAUSE * number
        readings = list(descent.readings)
        for k in range(int(SECONDS * FPS)):
            now = (k + 0.5) / FPS
            while readings and readings[0][0] <= now:
                at, reading = readings.pop(0)
                heights.reading_received(start + at, reading)
            seen = descent.height(now) * (1.0 + share) * (1.0 + EYES_SD * rng.standard_normal())
            heights.pose_seen(start + now, seen)
            told = told or heights.contradicts
    found, sd = heights.scale
    return Outcome(told, found - (1.0 - 1.0 / (1.0 + share)), sd)


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    return [
        Part(_fly, (share, descents, seeds.base + 1600 + k), descents)
        for (share, descents), flights in FLIGHTS.items()
        for k in range(2 if quick else flights)
    ]


def _sum_up(_quick: bool, parts: Sequence[Part], found: Sequence[Outcome]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    bound = scale_sd(Descent(0, yaws=False).height, SECONDS)
    for share, descents in FLIGHTS:
        ours = [one for part, one in zip(parts, found, strict=True) if part.args[:2] == (share, descents)]
        off, sd = np.array([one.off for one in ours]), np.array([one.sd for one in ours])
        rows[f"{100 * share:g} % in {descents} descents"] = {
            "flights": len(ours),
            "told": sum(one.told for one in ours),
            "rms_percent": round(100 * float(np.sqrt((off**2).mean())), 2),
            "sd_percent": round(100 * float(sd.mean()), 2),
            "bound_percent": round(100 * bound / (1 + share) / float(np.sqrt(descents)), 2),
        }
    return rows


BAROMETER: Final = Case(_plan, _sum_up)
"""Told, error and deviation of the scale by the barometer; no images."""

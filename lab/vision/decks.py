"""Targets that do not lie as the vehicle's attitude says: tilted and rocking decks, and an attitude that is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import radians
from typing import Final

from lab.vision.flight import LEVEL, VGA, FlightFrame, fly
from lab.vision.looks import WITH, Look, eyes, flights, look_at, summed
from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet, target_named
from mkdaemon.vision.tags.tagmap import Target
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mksim.scene.motion import Platform

Report = Callable[[AttitudeSample], AttitudeSample]
"""What a vehicle makes of its attitude."""
SECONDS: Final = 4.0
TILT: Final = radians(4.0)
BIAS: Final = radians(5.0)
JUMP: Final = radians(6.0)
JUMPS_AT: Final = SECONDS / 2
"""Since take-off [s]."""


@dataclass(frozen=True, slots=True)
class Lie:
    """How a target lies, and how the attitude is wrong."""

    deck: Platform = LEVEL
    report: Report = lambda sample: sample


LIES: Final = {
    "level": Lie(),
    "tilted": Lie(Platform(roll=TILT, pitch=-0.75 * TILT)),
    "rocking": Lie(Platform(rocking=TILT)),
    "attitude_biased": Lie(report=lambda s: AttitudeSample(s.time, s.roll + BIAS, s.pitch, s.yaw)),
    "attitude_jumps": Lie(
        report=lambda s: AttitudeSample(s.time, s.roll + (JUMP if s.time > JUMPS_AT else 0.0), s.pitch, s.yaw)
    ),
    "roll_sign_swapped": Lie(report=lambda s: AttitudeSample(s.time, -s.roll, s.pitch, s.yaw)),
    "both_signs_swapped": Lie(report=lambda s: AttitudeSample(s.time, -s.roll, -s.pitch, s.yaw)),
}
"""Decks of 4 degrees, and attitudes that are wrong from the start or from the middle of a flight on."""


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    rows = [f"{name}_{target}" for name in LIES for target in ("nested", "single")]
    return flights(_fly, rows, seeds.base + 1200, 1 if quick else 6, int(30 * SECONDS))


def _fly(row: str, seed: int) -> dict[str, list[Look]]:
    name, _, target_name = row.rpartition("_")
    target = target_named(target_name)
    return look_at(lied(name, target, seed, SECONDS), {WITH: eyes(target, VGA)[WITH]})


def lied(name: str, target: Target, seed: int, seconds: float) -> Iterator[FlightFrame]:
    """A flight over a deck, or with an attitude that is wrong."""
    lie = LIES[name]
    for frame in fly(target, seed, seconds=seconds, deck=lie.deck):
        yield replace(frame, attitude=AttitudeHistory(lie.report(sample) for sample in frame.attitude.samples))


DECKS: Final = Case(_plan, summed)
"""Posed, wrong and NEES where target and attitude disagree; images with the whole target in view."""

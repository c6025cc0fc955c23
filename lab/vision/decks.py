"""Targets that do not lie as the vehicle's attitude says: tilted and rocking decks, and an attitude that is wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import radians
from typing import Final

from lab.vision.flight import LEVEL
from mkdaemon.vision.track.attitude import AttitudeSample
from mksim.scene.motion import Platform

Report = Callable[[AttitudeSample], AttitudeSample]
"""What a vehicle makes of its attitude."""
TILT: Final = radians(4.0)
BIAS: Final = radians(5.0)
JUMP: Final = radians(6.0)
JUMPS_AT: Final = 2.0
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

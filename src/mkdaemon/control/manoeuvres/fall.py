"""How far a sinking aircraft must have come down at least, from its thrust alone.

Nothing on the line says that the feet stand. What is left without an image is physics: from the highest place where the
aircraft can have been, at the slowest sink it can have had, with the thrust that was sent and the cushion of the
ground, there is a time by which it has come down. Source of the cushion: I. Cheeseman and W. Bennett, ARC R&M 3021,
1955.
"""

from __future__ import annotations

from typing import Final

from mkdaemon.control.estimator.model import GRAVITY

DEVIATIONS: Final = 3.0
"""The aircraft is no higher than this many standard deviations above its estimate."""
CLIMB_DOUBT: Final = 0.15
"""It sinks slower than estimated by this at most [m/s]."""
THRUST_DOUBT: Final = 1.08
"""Its thrust is larger than estimated by this factor at most: 4 % of hover throttle."""
ROTOR_RADIUS: Final = 0.2
"""Of the largest rotors this flies with [m]; docs/simulator.md."""
ROTOR_HEIGHT: Final = 0.1
"""Of the rotors above the feet, at least [m]."""
LARGEST_CUSHION: Final = 1.25
"""Largest gain of thrust near the ground; docs/simulator.md."""


class Fall:
    """A fall from a commit on.

    Attributes:
        height: largest height of the feet above the ground that is possible now [m].
        climb: largest climb rate that is possible now [m/s].
    """

    def __init__(self, height: float, climb: float, height_sd: float) -> None:
        """Begin.

        Args:
            height: estimated, of the feet above the ground [m].
            climb: estimated [m/s].
            height_sd: standard deviation of the height [m].
        """
        self.height = height + DEVIATIONS * height_sd
        self.climb = climb + CLIMB_DOUBT

    def has_ended(self, thrust: float, step: float) -> bool:
        """Go on for a time; whether the aircraft stands, wherever it began.

        Args:
            thrust: that the motors give, out of the cushion [share of the weight].
            step: [s].
        """
        lift = thrust * THRUST_DOUBT * _cushion(self.height)
        self.climb += GRAVITY * (lift - 1.0) * step
        self.height += self.climb * step
        return self.height <= 0.0


def _cushion(height: float) -> float:
    """Gain of thrust with the feet at a height above the ground [m]."""
    ratio = (ROTOR_RADIUS / (4.0 * (max(height, 0.0) + ROTOR_HEIGHT))) ** 2
    return min(1.0 / (1.0 - ratio), LARGEST_CUSHION) if ratio < 1.0 else LARGEST_CUSHION

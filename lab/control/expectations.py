"""What may follow from a fault of a flight."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from lab.control.faultrig import FaultRig

TOLERANCE: Final = 1.2
"""A trigger fires at its time, at most so much later: docs/safety.md."""


@dataclass(frozen=True, slots=True)
class Expectation:
    """What may follow from a fault.

    Attributes:
        reasons: what the reason of a release may begin with or contain; of a client whose setpoints are refused and
            which has none left, what the refusal may contain.
        within: it must come so soon after the fault [s]; infinite where it need not.
    """

    reasons: tuple[str, ...] = ()
    within: float = math.inf


NOTHING: Final = Expectation()
LOST_SIGHT: Final = ("no image of", "it needs a fresh image of")
"""Images that are gone for too long end a flight, and what needs one cannot begin while they come late."""

Fault = Callable[[FaultRig, float, random.Random], Expectation]
"""Prepares a fault that begins at a time [s]; its numbers are drawn."""

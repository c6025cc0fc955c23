"""The scenes of the proving ground: what is flown, how it varies with the seed, and what it has to reach."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from lab.hil.flights import FOLLOWING, SHORT, WHOLE, Setting

FIRST_SEED: Final = 71_000_000
"""Of reported figures; what is tuned uses seeds below 1000."""


@dataclass(frozen=True, slots=True)
class Goal:
    """The largest value of a figure that holds.

    Attributes:
        most: it [unit of the figure].
        of: which of the flights' values is judged: the median, the 90th percentile, the worst.
    """

    most: float
    of: str = "median"


@dataclass(frozen=True, slots=True)
class Scene:
    """One row.

    Attributes:
        about: in words.
        setting: makes the setting of a firmware (None for simulated boards) and a seed.
        goals: by figure; more than one may judge the same.
        flights: how many.
    """

    about: str
    setting: Callable[[str | None, int], Setting]
    goals: tuple[tuple[str, Goal], ...]
    flights: int = 10


def _drawn(seed: int, what: str, values: tuple[Any, ...]) -> Any:
    return random.Random(f"{seed} {what}").choice(values)


def _headings(firmware: str | None, seed: int) -> Setting:
    yaw = random.Random(f"{seed} yaw").uniform(-math.pi, math.pi)
    return Setting(firmware, SHORT, seed, yaw=yaw, has_compass=_drawn(seed, "compass", (True, False)))


def _voltages(firmware: str | None, seed: int) -> Setting:
    return Setting(firmware, SHORT, seed, voltage=_drawn(seed, "voltage", (12.8, 13.6, 14.8, 15.6, 16.4, 16.8)))


_LANDING: Final = ("touch_cm", Goal(6.0, "p90"))
_TRUTHFUL: Final = (("false_lid", Goal(0.0, "worst")), ("filter_off_ms", Goal(10.0, "worst")))
SCENES: Final[dict[str, Scene]] = {
    "cable": Scene(
        "by cable: take-off, hold in three winds, a step of 1 m, landing in light wind",
        lambda firmware, seed: Setting(firmware, WHOLE, seed),
        (
            ("hold_cm", Goal(3.2)),
            ("hold_cm", Goal(4.5, "worst")),
            ("light_cm", Goal(8.0)),
            ("moderate_cm", Goal(14.0)),
            ("step_t90", Goal(1.7)),
            ("step_over_percent", Goal(10.0, "p90")),
            _LANDING,
            *_TRUTHFUL,
        ),
    ),
    "radio": Scene(
        "the same by a radio",
        lambda firmware, seed: Setting(firmware, WHOLE, seed, is_radio=True),
        (("hold_cm", Goal(4.5)), _LANDING, *_TRUTHFUL),
    ),
    "moving": Scene(
        "landing on a pad that moves with 0.5 m/s, in light wind",
        lambda firmware, seed: Setting(firmware, FOLLOWING, seed, pad_speed=0.5),
        (("touch_cm", Goal(9.0, "p90")), *_TRUTHFUL),
    ),
    "voltages": Scene("batteries of 12.8 to 16.8 V", _voltages, (_LANDING, *_TRUTHFUL)),
    "headings": Scene("any heading, with and without a compass", _headings, (_LANDING, *_TRUTHFUL)),
}
"""By name."""

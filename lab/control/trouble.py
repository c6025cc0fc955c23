"""What is wrong in a flight with faults, and what may follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

TOLERANCE: Final = 1.2
"""A trigger fires at its time, at most so much later: docs/safety.md."""


class Expectation(NamedTuple):
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


@dataclass(slots=True)
class Trouble:
    """What is wrong at the moment; times are ends [s].

    Attributes:
        client_silent: the client streams nothing.
        client_late: largest delay of a setpoint [s].
        client_wild: the client streams nonsense.
        blind: images show no target.
        camera_late: poses come later by this [s].
        camera_wrong: poses are off by this [m].
        eyes_stalled: no pose comes before this time; then all of them do.
        core_stalled: the core does not run, from a beginning to an end.
        telemetry_silent: no attitude is heard.
        uplink_dead: no stick frame arrives.
        lids: the pilot's throttle lies so far below hover [stick], each from a beginning to an end.
    """

    client_silent: float = 0.0
    client_late: tuple[float, float] = (0.0, 0.0)
    client_wild: float = 0.0
    blind: float = 0.0
    camera_late: tuple[float, float] = (0.0, 0.0)
    camera_wrong: tuple[float, float] = (0.0, 0.0)
    eyes_stalled: float = 0.0
    core_stalled: tuple[float, float] = (0.0, 0.0)
    telemetry_silent: float = 0.0
    uplink_dead: float = 0.0
    lids: list[tuple[float, float, float]] = field(default_factory=list)

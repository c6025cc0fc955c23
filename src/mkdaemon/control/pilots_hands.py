"""The pilot's task by phase, manoeuvre and stage: one table, published in `control/status`. Pure.

Stock firmware takes the smaller of the pilot's throttle and ours, so his stick is the lid of every flight:
docs/flying.md, "Who controls the throttle". docs/modes.md shows the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mkdaemon.control.manoeuvres.land import LandingPhase
from mkdaemon.control.manoeuvres.take_off import TakeOffPhase
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.telemetry.control import Phase, Progress
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, LandSetpoint, StickSetpoint, TakeOffSetpoint

LID: Final = "holds the throttle a quarter above hover, the other sticks centred, ready to shut the gate"
"""In nearly every automatic flight."""
CAPPED: Final = "raises the throttle above hover, now: the smaller throttle counts, and the aircraft sinks"
"""In flight while the pilot's throttle is the smaller one."""


@dataclass(frozen=True, slots=True)
class Hands:
    """One row.

    Attributes:
        phase: of authority.
        manoeuvre: kind of the setpoint; empty for any.
        stage: of the manoeuvre; empty for any.
        words: what the pilot does, after "the pilot".
    """

    phase: Phase
    manoeuvre: str
    stage: str
    words: str


def _flying(kind: str, stage: str, words: str) -> Hands:
    return Hands(Phase.FLYING, kind.removeprefix("setpoint/"), stage, words)


_LANDING: Final = LandSetpoint.suffix.removeprefix("setpoint/")
_STANDS: Final = "pulls the throttle down, stops the motors, then shuts the gate"
_BY_HAND: Final = f"{LID}; the position is not held"
HANDS: Final = (
    Hands(Phase.FREE, "", "", "flies"),
    Hands(
        Phase.LEASED,
        "",
        "",
        "hovers still over the target, or starts the motors and leaves the throttle at its lowest; sticks centred, he "
        "opens the gate to hand over",
    ),
    _flying(
        TakeOffSetpoint.suffix,
        TakeOffPhase.IDLE.value,
        "raises the throttle to a quarter above hover within 3 s; nothing moves yet",
    ),
    _flying(LandSetpoint.suffix, LandingPhase.DOWN.value, _STANDS),
    _flying(LandSetpoint.suffix, "", "holds the throttle a quarter above hover until touchdown, then lowers it"),
    _flying(StickSetpoint.suffix, "", _BY_HAND),
    _flying(AttitudeSetpoint.suffix, "", _BY_HAND),
    Hands(Phase.FLYING, "", "", LID),
    Hands(Phase.STALE, "", "", "shuts the gate and flies, unless the setpoints resume at once"),
    Hands(
        Phase.UNANSWERED,
        "",
        "",
        "flies; to hand over he hovers still over the target, throttle a quarter above hover, sticks centred, and "
        "opens the gate",
    ),
    Hands(Phase.ABORTED, "", "", f"{LID}; shuts the gate to take over"),
    Hands(Phase.LANDING, _LANDING, LandingPhase.DOWN.value, _STANDS),
    Hands(Phase.LANDING, "", "", "holds the throttle a quarter above hover until touchdown, then lowers it"),
    Hands(Phase.RELEASING, _LANDING, LandingPhase.DOWN.value, _STANDS),
    Hands(Phase.RELEASING, "", "", "flies: throttle back to hover at once, or the aircraft climbs"),
)
"""The first row that fits counts."""
_LOW_THROTTLE: Final = frozenset({TakeOffPhase.IDLE.value, LandingPhase.DOWN.value})
"""Stages in which the pilot's throttle may be the smaller one."""


def pilots_hands(phase: Phase, progress: Progress | None, *, is_capped: bool) -> str:
    """The pilot's present task, after "the pilot".

    Args:
        phase: of authority.
        progress: what is flown; None while nothing is.
        is_capped: his throttle caps ours.
    """
    manoeuvre, stage = ("", "") if progress is None else (progress.manoeuvre, progress.stage)
    if is_capped and phase in IN_FLIGHT and stage not in _LOW_THROTTLE:
        return CAPPED
    return next(
        row.words
        for row in HANDS
        if row.phase is phase and row.manoeuvre in ("", manoeuvre) and row.stage in ("", stage)
    )

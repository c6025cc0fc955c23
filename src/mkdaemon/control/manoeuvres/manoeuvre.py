"""Base class of manoeuvres: a manoeuvre turns setpoints of one kind into sticks, from start to end.

What it remembers (place, reference, stage) belongs to it and ends with it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from mkdaemon.control.estimator.liftoff import LiftOff
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.control import ErrorValue, Outcome
from mkdaemon.telemetry.path import PathProgress

WORDS: dict[Outcome, str] = {
    Outcome.LANDED: "landed on {target}",
    Outcome.LANDED_ASIDE: "came down, but nothing shows that it stands on {target}",
    Outcome.NO_TARGET: "no target in sight",
    Outcome.SIGHT_LOST: "no image of {target} for {age:.1f} s",
    Outcome.TAKE_OFF_ABORTED: "take-off ended: aborted",
    Outcome.TIPPED: "take-off ended: it tips over: is a foot caught?",
    Outcome.NOT_LIFTED: (
        "take-off ended: no image shows it off the ground: gate shut, the pilot's throttle too low, motors off, "
        "control.limiter.hover_throttle too small for its weight, or images too old"
    ),
}
"""What is said of every way in which a manoeuvre ends by itself."""
REACHED_ITS_END = frozenset({Outcome.LANDED, Outcome.LANDED_ASIDE})
"""Ends that were asked for; all others are failures."""


@dataclass(frozen=True, slots=True)
class End:
    """A manoeuvre has ended: the aircraft is released.

    Attributes:
        outcome: how.
        words: why, one sentence.
    """

    outcome: Outcome
    words: str

    @property
    def is_failure(self) -> bool:
        """Whether this end was not requested."""
        return self.outcome not in REACHED_ITS_END


def ended(outcome: Outcome, **words: object) -> End:
    """End with an outcome; `words` fill in its sentence."""
    return End(outcome, WORDS[outcome].format(**words))


@dataclass(frozen=True, slots=True)
class Step:
    """Output of a manoeuvre in one tick.

    Attributes:
        sticks: before the limiter [stick; FLU].
        manoeuvre: its shown name.
        obstacle: what keeps a flight from beginning with it, in words; empty for nothing.
        stage: where it stands, in words; empty for a manoeuvre that has no stages.
        longest: how long its stage may last [s], until it is done: then it is aborted. Every stage has an end.
        is_done: what was asked for is reached, and is held from now on.
        end: how it has ended; None while it goes on.
        error: how far the aircraft is from its goal; None without a goal.
        stands: the aircraft stands on the ground, where nothing is estimated: no model here knows the ground.
        may_touch: the ground may hold the aircraft's tilt, so that no answer to its sticks says nothing.
        is_unanswered: the aircraft does not answer its sticks.
        is_level: level at hover throttle as the last resort, not on request.
        path: how far a flight along a path is; None for all others.
    """

    sticks: Sticks
    manoeuvre: str
    obstacle: str = ""
    stage: str = ""
    longest: float = 0.0
    is_done: bool = False
    end: End | None = None
    error: ErrorValue | None = None
    stands: bool = False
    may_touch: bool = False
    is_unanswered: bool = False
    is_level: bool = False
    path: PathProgress | None = None


class Manoeuvre(ABC):
    """One manoeuvre, flown once.

    Attributes:
        kind: its shown name.
        is_by_target: it follows what images of a target show.
        keeps_place: it goes on by itself when its setpoints say nothing new.
        is_timed_whole: its stages come again and again, so all of them together may last for `Step.longest`.
        stepped_at: when it was asked last [s].
    """

    kind: ClassVar[str]
    is_by_target: ClassVar[bool] = False
    keeps_place: ClassVar[bool] = False
    is_timed_whole: ClassVar[bool] = False

    def __init__(self, sight: Sight, setpoint: Any = None) -> None:
        """Prepare, by what is known of the target and, where there is one, by its setpoint; `enter` begins it."""
        self.stepped_at = -math.inf
        self._sight, self._wanted = sight, setpoint

    def enter(self, before: Manoeuvre | None, now: float) -> str:
        """Begin, on the ground (`before` is None) or after another manoeuvre.

        Returns:
            What it waits for, in words; empty for nothing.
        """
        return ""

    def follow(self, setpoint: Any) -> None:
        """Take the newest setpoint, of the kind it was made for."""
        self._wanted = setpoint

    @abstractmethod
    def step(self, now: float, *, is_flying: bool) -> Step:
        """Decide the sticks at a time [s]; `is_flying`: they are being sent."""

    def height_seen(self, height: float, at: float, *, is_placed: bool = False) -> LiftOff | None:
        """Take the height above the target that an image shows [m], and when it was taken [s].

        Args:
            height: [m].
            at: [s].
            is_placed: a source of poses shows it.

        Returns:
            How it left the ground, where this image is the first that shows it.
        """
        return None

    @abstractmethod
    def abort(self, now: float) -> Manoeuvre:
        """Stop; returns the manoeuvre that it becomes, which may be itself."""


def level_at(gas: float) -> Sticks:
    """No tilt at a throttle [count of 254]."""
    return Sticks(0.0, 0.0, 0.0, round(gas - GAS_CENTRE))

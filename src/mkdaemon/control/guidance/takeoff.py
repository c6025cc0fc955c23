"""Take-off from the ground: throttle rises until an image shows the aircraft above it, then the autopilot climbs.

A camera that stands on its target sees little or nothing of it, so the first centimetres are flown blind, level and
quickly: the wind carries the aircraft out of the camera's cone as fast as slow throttle lets it rise. How much blind
throttle, and for how long, is bounded. Source: docs/control.md, "Take-off".
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from mkdaemon.control.estimator.model import GRAVITY

IDLE_GAS: Final = 27.0
"""Throttle that carries nothing [count of 254]."""
LIKELY: Final = (0.75, 1.25)
"""Throttle that carries the aircraft, over what was believed to."""
OLDEST: Final = 0.6
"""An older image proves nothing [s]: the estimator could not roll back to it, and would fly on from where it was."""


class TakeOffPhase(StrEnum):
    """Where a take-off stands; the value is what is shown."""

    IDLE = "idle: the pilot raises his throttle"
    """Lowest throttle; on stock firmware nothing moves while ours is the smaller one."""
    RAMP = "throttle rises"
    """Level, more and more throttle, until images show the aircraft off the ground."""
    CLIMB = "climbs"
    """The autopilot flies to the height asked for."""
    REACHED = "at height"
    """It holds there."""
    FAILED = "failed"
    """Nothing showed that it lifts off, or it tips over: it is released."""


@dataclass(frozen=True, slots=True)
class TakeOffLimits:
    """Throttle and times.

    Attributes:
        ready: time at the lowest throttle before it rises [s].
        stand_height: of the body origin above the target when the feet stand [m].
        lift: this much higher, the aircraft flies [m].
        cushion: mean gain of thrust by the ground on the way there.
        first: to this share of hover throttle it rises at once [share].
        rise: from there on [share of hover a second].
        most: blind throttle ends here [share of hover].
        counts_from: the blind time counts from this throttle on [share of hover].
        blind: longest time above it without an image of a flying aircraft [s].
        steepest: tilt on the ground at which it ends: a foot that sticks tips the aircraft over [rad].
        cut: after that the throttle is at its lowest for this long before the release [s].
    """

    ready: float = 3.0
    stand_height: float = 0.10
    lift: float = 0.06
    cushion: float = 1.1
    first: float = 0.80
    rise: float = 1.60
    most: float = 1.25
    counts_from: float = 1.05
    blind: float = 1.2
    steepest: float = 0.26
    cut: float = 1.0


class TakeOff:
    """One take-off.

    Attributes:
        phase: where it stands.
        failure: why it failed; empty before.
    """

    def __init__(self, limits: TakeOffLimits, hover_gas: float, now: float, *, is_in_air: bool = False) -> None:
        """Begin.

        Args:
            limits: throttle and times.
            hover_gas: throttle that is believed to carry the aircraft [count of 254].
            now: [s].
            is_in_air: it flies already, so that only the climb is left.
        """
        self.phase = TakeOffPhase.CLIMB if is_in_air else TakeOffPhase.IDLE
        self.failure = ""
        self._limits = limits
        self._hover_gas = hover_gas
        self._began = now
        self._share = IDLE_GAS / hover_gas
        self._strong_since: float | None = None
        self._history: deque[tuple[float, float]] = deque([(now, IDLE_GAS)])
        self._cut_left = 0.0
        self._seen = (0.0, now)

    @property
    def is_blind(self) -> bool:
        """Whether throttle is computed here and not by the autopilot."""
        return self.phase not in (TakeOffPhase.CLIMB, TakeOffPhase.REACHED)

    @property
    def is_over(self) -> bool:
        """Whether a failed take-off is to be released."""
        return self.phase is TakeOffPhase.FAILED and self._cut_left <= 0.0

    def gas(self, now: float, step: float, tilt: float) -> float:
        """Go on for a time; the throttle to send [count of 254].

        Args:
            now: [s].
            step: time since the last call [s].
            tilt: largest angle that the boards report, pitch or roll [rad].
        """
        limits = self._limits
        if self.phase is TakeOffPhase.IDLE and now - self._began >= limits.ready:
            self.phase = TakeOffPhase.RAMP
            self._share = limits.first
        elif self.phase is TakeOffPhase.RAMP:
            self._share = min(self._share + limits.rise * step, limits.most)
            if self._strong_since is None and self._share >= limits.counts_from:
                self._strong_since = now
            if tilt > limits.steepest:
                self.fail("it tips over: is a foot caught?")
                self._share, self._cut_left = IDLE_GAS / self._hover_gas, limits.cut
            elif self._strong_since is not None and now - self._strong_since > limits.blind:
                self.fail(
                    "no image shows it off the ground: gate shut, the pilot's throttle too low, motors off, "
                    "control.limiter.hover_throttle too small for its weight, or images too old"
                )
        elif self.phase is TakeOffPhase.FAILED:
            self._cut_left -= step
        gas = self._share * self._hover_gas
        self._history.append((now, gas))
        while self._history[0][0] < now - OLDEST and len(self._history) > 1:
            self._history.popleft()
        return gas

    def fail(self, why: str) -> None:
        """End it, as long as no image has shown it off the ground: whether it flies nobody knows then.

        So it goes to the pilot as it is: throttle that goes down would drop an aircraft that flies.
        """
        if self.is_blind:
            self.phase, self.failure = TakeOffPhase.FAILED, why

    def seen(self, height: float, at: float) -> float | None:
        """Take the height an image shows; once images show that it flies, the throttle that carries it.

        From standing it has reached its height with a mean acceleration of v^2 / 2h, more than its throttle gives in
        free air by what the cushion adds.

        Args:
            height: of the body origin above the target [m].
            at: when the image was taken [s].
        """
        limits = self._limits
        if self.phase is not TakeOffPhase.RAMP or self._history[-1][0] - at > OLDEST:
            return None
        flown = height - limits.stand_height
        before, before_at = self._seen
        self._seen = (flown, at)
        if flown <= limits.lift or before <= limits.lift or at <= before_at:
            return None
        self.phase = TakeOffPhase.CLIMB
        climb = max(0.0, (flown - before) / (at - before_at))
        gas = next((gas for time, gas in reversed(self._history) if time <= at), self._history[0][1])
        hover = gas * math.sqrt(limits.cushion / (1.0 + climb**2 / (2.0 * flown) / GRAVITY))
        return min(max(hover, LIKELY[0] * self._hover_gas), LIKELY[1] * self._hover_gas)

    def arrived(self) -> None:
        """Note that the aircraft holds at the height asked for."""
        if self.phase is TakeOffPhase.CLIMB:
            self.phase = TakeOffPhase.REACHED

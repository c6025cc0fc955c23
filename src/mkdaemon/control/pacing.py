"""Times of the flight core's ticks: at once after news, in time to repeat a setpoint, just after a deadline.

A flight by images is the other way round: an image is answered at once, and between two the core ticks at its own rate,
whenever setpoints come. What is streamed there hardly changes, and what an image shows is late enough. The last tick
before an image is expected leaves room on both sides: one that comes early finds boards that can take its answer, one
that comes late no frame that was sent in its place.
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.config.control import ControlConfig

JUST_AFTER: Final = 0.0002
"""Margin after which a deadline has certainly passed [s]."""
IDLE_PERIOD: Final = 0.1
"""Time between two checks of the lease without a flight [s]."""
SLOWEST_IMAGES: Final = 0.25
"""Images further apart have no rhythm worth dividing [s]."""
EARLY: Final = 0.003
"""An image this early is answered at once [s]. The rest of a period is for late images, which would wait longest."""
NEARLY: Final = 0.25
"""A time that is longer than whole ticks by less than this part of one has no place for another."""
SLOW_LINE: Final = 1.4
"""On a line whose frame interval is longer than the period of `control.rate`, the tick waits up to this factor times
the interval for the next image [1]; without the wait, the image's answer would wait another interval."""


class Pacing:
    """The times of the ticks.

    Attributes:
        is_paced: stick frames are being sent, so no tick comes sooner than the boards can take the next one.
        is_by_images: what is flown follows what images show.
        answers_image: the present tick was brought forward by one.
    """

    def __init__(self, cfg: ControlConfig) -> None:
        self._cfg = cfg
        self._image_period: float | None = None
        self._captured = float("-inf")
        self._ticks_since_image = 0
        self._ticked_at = float("-inf")
        self.is_paced = self.is_by_images = self.answers_image = self._is_image_new = False
        self._is_due = True

    def hurry(self) -> None:
        """Note that something happened that the next tick must judge."""
        self._is_due = True

    def image_taken(self, captured: float, *, is_ours: bool) -> bool:
        """Note that an image showed where the aircraft is; returns whether it is to be answered at once.

        Args:
            captured: middle of its exposure [s].
            is_ours: against the target it is flown by.
        """
        if is_ours:
            period, self._captured = captured - self._captured, captured
            self._image_period = period if 0.0 < period <= SLOWEST_IMAGES else None
        is_answered = self.is_by_images and is_ours
        self._is_image_new = self._is_image_new or is_answered
        return is_answered

    def sends(self, *, is_flying: bool, is_by_images: bool) -> None:
        """Note what is sent from now on; see the attributes."""
        self.is_paced, self.is_by_images = is_flying, is_flying and is_by_images

    def tick(self, now: float) -> float:
        """Note a tick; returns the time since the one before [s]."""
        stood_still = now - self._ticked_at
        self._ticked_at, self._is_due = now, False
        self.answers_image, self._is_image_new = self._is_image_new, False
        self._ticks_since_image = 0 if self.answers_image else self._ticks_since_image + 1
        return stood_still

    def next_time(self, deadline: float | None, next_step: float, step: float) -> float:
        """When to tick again [s].

        A repetition so shortly before a deadline that what follows would have to wait for the boards is left out.

        Args:
            deadline: when silence changes what is sent [s]; None for never.
            next_step: when the boards can take the next stick frame [s].
            step: least time between two stick frames [s].
        """
        until = self._ticked_at
        if not self._is_due:
            until += self._period(step)
            if deadline is not None and until > deadline - step:
                until = deadline + JUST_AFTER
        return max(until, next_step) if self.is_paced else until

    def _period(self, step: float) -> float:
        """Longest time from this tick to the next [s]; stick frames are at least `step` apart [s].

        Images are `images` apart [s], with `between` ticks between two of them.
        """
        if not self.is_paced:
            return IDLE_PERIOD
        period, images = 1.0 / self._cfg.rate, self._image_period
        if not self.is_by_images:
            # A repetition waits half a period longer than a client should, or it would delay the next setpoint.
            return 1.5 * period
        if images is None:
            return period
        longest = max(period, SLOW_LINE * step)
        last = images - step - EARLY
        between = max(0, min(math.ceil(last / longest - NEARLY), math.floor(last / step)))
        apart = max(step, min(last / between, longest)) if between else 0.0
        if self._ticks_since_image < between:
            return apart
        if self._ticks_since_image == between:
            return max(longest, images - between * apart + longest - step - EARLY)
        return period

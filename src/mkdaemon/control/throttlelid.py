"""Notices that the pilot's throttle caps ours: stock firmware takes the smaller of the two. Pure.

The FlightCtrl reports the throttle it flies with. Where that stays below everything we sent for a while, it is the
pilot's stick. Source: docs/flying.md, "Who controls the throttle"; docs/protocol.md, "Debug channels of the
FlightCtrl" and the field `throttle` of the NaviCtrl's OSD data.

It reports the throttle after the compensation of the battery's voltage: at 14.8 V a hover reads 19 counts less than
its stick. A NaviCtrl takes that back again. By the voltage of the same message that share is known
(`ThrottleReport.share`), unless more than it is seen: then the board reports the stick itself. Where no voltage is
known, what is shown compares the numbers as they are, and flight goes by the largest share of ours that was ever
reported in this flight: only a smaller share is the pilot's throttle, because a pilot's stick does not follow ours.
A share below `LEAST_SHARE` is none of the compensation, also at the beginning of a flight.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from mkdaemon.config.control import LOWEST_HOVER
from mkdaemon.control.estimator.values import GAS_CENTRE, OURS, ThrottleUse
from mkdaemon.control.vehicle import FRESH, ThrottleReport

MARGIN: Final = 6.0
"""Less than ours by more than this is the pilot's [stick]; the FlightCtrl rounds, and one count is 1.6 % of thrust."""
WINDOW: Final = 0.5
"""Longest time from a stick frame to the report of its throttle [s]: uplink, receiver frame, and the way back behind
other frames take 0.4 s at worst."""
LASTING: Final = 0.4
"""Only a difference that lasts counts [s]."""
LEAST_SHARE: Final = 0.7
"""Smallest share that the compensation leaves: a low-voltage limit of 3.0 V, at `vehicle.HIGHEST_CELL`."""


class ThrottleLid:
    """Compares what we send with what the FlightCtrl flies with.

    Attributes:
        pilots_throttle: the pilot's throttle while it caps ours [stick from the centre]; None while it does not, or
            if no board reports it.
        use: for the flight.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[float, float]] = deque()
        self._reported_at = self._made_at = -math.inf
        self._forget()

    def _forget(self) -> None:
        """Restart: frames flown by hand between two flights do not count."""
        self._sent.clear()
        self.pilots_throttle: float | None = None
        self.use = OURS
        self._lower_since: float | None = None
        self._capped_since: float | None = None
        self._scale = LEAST_SHARE
        self._is_stick = False
        self._compared_at: float | None = None

    def frame_made(self, throttle: float, report: ThrottleReport | None, now: float) -> None:
        """Take the throttle of a stick frame that goes out now [stick; s], and the newest report."""
        if now - self._made_at > WINDOW:
            self._forget()
        self._made_at = now
        self._sent.append((now, throttle))
        while now - self._sent[0][0] > 2.0 * WINDOW:
            self._sent.popleft()
        if report is not None and report.at > self._reported_at:
            self._reported_at = report.at
            self._compare(report)
        if self._compared_at is not None and now - self._compared_at > FRESH:
            self.use = ThrottleUse(None, is_ours=False)  # there were reports, and now there are none

    def _compare(self, report: ThrottleReport) -> None:
        ours = [throttle for at, throttle in self._sent if report.at - WINDOW <= at <= report.at]
        if not ours or report.at - self._sent[0][0] < WINDOW:
            return
        self._compared_at = report.at
        flown, lowest, highest = (throttle + GAS_CENTRE for throttle in (report.throttle, min(ours), max(ours)))
        self._find_scale(report.share, flown, lowest, highest)
        self._show(report.at, flown, lowest, 1.0 if report.share is None else self._scale)
        if flown >= self._scale * lowest - MARGIN:
            self._capped_since = None
            self.use = ThrottleUse(None, is_ours=flown <= highest + MARGIN)
            return
        if self._capped_since is None:
            self._capped_since = report.at
        has_lasted = report.at - self._capped_since >= LASTING
        self.use = ThrottleUse(flown / self._scale if has_lasted else None, is_ours=False)

    def _find_scale(self, share: float | None, flown: float, lowest: float, highest: float) -> None:
        """Find what share of a stick is reported."""
        if share is None:
            self._scale = max(self._scale, min(flown / max(highest, 1.0), 1.0))
            return
        # Below the motors' least throttle a report does not show the stick.
        differs = (1.0 - share) * lowest > MARGIN
        self._is_stick = self._is_stick or (differs and flown > share * highest + MARGIN)
        self._scale = 1.0 if self._is_stick else share

    def _show(self, at: float, flown: float, lowest: float, scale: float) -> None:
        # What carries no aircraft is capped by nothing worth a word: after a touch both sticks are at their lowest.
        if flown >= scale * lowest - MARGIN or lowest < LOWEST_HOVER + GAS_CENTRE:
            self._lower_since = self.pilots_throttle = None
            return
        if self._lower_since is None:
            self._lower_since = at
        if at - self._lower_since >= LASTING:
            self.pilots_throttle = flown / scale - GAS_CENTRE

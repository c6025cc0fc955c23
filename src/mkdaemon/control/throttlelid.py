"""Notices that the pilot's throttle caps ours: stock firmware takes the smaller of the two. Pure.

The FlightCtrl reports the throttle it flies with. Where that stays below everything we sent for a while, it is the
pilot's stick. Source: docs/flying.md, "Who holds what: the throttle"; docs/protocol.md, "Debug channels of the
FlightCtrl" and the field `throttle` of the NaviCtrl's OSD data.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from mkdaemon.control.vehicle import ThrottleReport

MARGIN: Final = 6.0
"""Less than ours by more than this is the pilot's [stick]; the FlightCtrl rounds, and one count is 1.6 % of thrust."""
WINDOW: Final = 0.5
"""A report is of one of the frames made so long before it arrived [s]: uplink, receiver frame, and the way back behind
other frames, 0.4 s at worst."""
LASTING: Final = 0.4
"""Only a difference that lasts counts [s]."""


class ThrottleLid:
    """Compares what we send with what the FlightCtrl flies with.

    Attributes:
        pilots_throttle: the pilot's throttle while it caps ours [stick from the centre]; None while it does not, or
            nobody says so.
    """

    def __init__(self) -> None:
        self.pilots_throttle: float | None = None
        self._sent: deque[tuple[float, float]] = deque()
        self._reported_at = self._made_at = float("-inf")
        self._lower_since: float | None = None

    def frame_made(self, throttle: float, report: ThrottleReport | None, now: float) -> None:
        """Take the throttle of a stick frame that goes out now [stick; s], and the newest report."""
        if now - self._made_at > WINDOW:
            self._sent.clear()  # another flight: what the pilot flew by hand in between says nothing
            self._lower_since = self.pilots_throttle = None
        self._made_at = now
        self._sent.append((now, throttle))
        while now - self._sent[0][0] > 2.0 * WINDOW:
            self._sent.popleft()
        if report is not None and report.at > self._reported_at:
            self._reported_at = report.at
            self._compare(report)

    def _compare(self, report: ThrottleReport) -> None:
        ours = [throttle for at, throttle in self._sent if report.at - WINDOW <= at <= report.at]
        if not ours or report.at - self._sent[0][0] < WINDOW:
            return
        if report.throttle >= min(ours) - MARGIN:
            self._lower_since = self.pilots_throttle = None
            return
        if self._lower_since is None:
            self._lower_since = report.at
        if report.at - self._lower_since >= LASTING:
            self.pilots_throttle = report.throttle

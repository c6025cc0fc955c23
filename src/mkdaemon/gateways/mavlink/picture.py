"""What the gateway knows of the aircraft: the newest value of every key it reads, and how old each is."""

from __future__ import annotations

import math
import threading
from typing import Final, TypeVar

from mkdaemon.reading import Picture as Known
from mkdaemon.reading import Reading
from mkdaemon.reading.known import KEYS, key_of
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.state import Position

_Value = TypeVar("_Value")

READ: Final = (*KEYS, "control/navi", "control/path", "vision/*/setup")
"""Keys that are watched, without events; the last values are asked for at the start."""


class LinkPicture:
    """The newest values by their kind; what is older than its key allows is not shown. Any thread may use it.

    Attributes:
        now: of the moment that is looked at [s].
        ground: height of home above the sea [m]; None while it is not known. It is that of the first moment after home
            was set: GPS and barometer drift against each other, and home does not move.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self.ground: float | None = None
        self._boot, self._ahead = "", -math.inf
        self._home: tuple[float | None, float | None] = (None, None)
        self._reading = Reading()
        self._lock = threading.Lock()

    def take(self, value: object, at: float, age: float = 0.0) -> None:
        """Keep a value.

        Args:
            value: of the daemon; events are left alone.
            at: when it came [s].
            age: how old it was then [s].
        """
        stamp = getattr(value, "stamp", None)
        with self._lock:
            self.now = max(self.now, at)
            if stamp is not None and age == 0.0:
                self._compare_clocks(stamp, at)
            self._reading.take(key_of(value), value, at - age)
            if isinstance(value, Position):
                self._take_home(value)

    @property
    def boot_time(self) -> float:
        """The daemon's monotonic clock, which all times since boot are of; ours while nothing came from it [s]."""
        return self.now + (self._ahead if math.isfinite(self._ahead) else 0.0)

    def _compare_clocks(self, stamp: Stamp, at: float) -> None:
        """Learn how far the daemon's clock is ahead of ours: a value that came quickly shows it best."""
        if stamp.boot != self._boot:
            self._boot, self._ahead = stamp.boot, -math.inf
        self._ahead = max(self._ahead, stamp.monotonic - at)

    def _take_home(self, here: Position) -> None:
        home = (here.home_latitude_deg, here.home_longitude_deg)
        if home != self._home:
            self._home, self.ground = home, None
        if self.ground is None and None not in (*home, here.altitude, here.altitude_above_start):
            assert here.altitude is not None and here.altitude_above_start is not None
            self.ground = here.altitude - here.altitude_above_start

    @property
    def above_sea(self) -> float | None:
        """Height above the sea that is sent: that of home, which stays, and the height above it [m].

        One reference for all heights, so that a commanded height means the same as a published height:
        the altitude of the GPS drifts by metres against the barometer that the NaviCtrl flies by.
        """
        here = self.get(Position)
        if here is None or here.altitude_above_start is None or self.ground is None:
            return None
        return self.ground + here.altitude_above_start

    @property
    def known(self) -> Known:
        """What is known now; each look has its own, for it notes what it reads."""
        with self._lock:
            return self._reading.at(self.now)

    def get(self, kind: type[_Value], *, is_old: bool = False) -> _Value | None:
        """The newest value of a kind; None where there is none, or it is too old.

        Args:
            kind: its class.
            is_old: it may be of any age.
        """
        known = self.known
        found = known.of_kind(kind)
        return None if found is None or (not is_old and known.is_stale(found)) else found.value

    @property
    def link(self) -> LinkState | None:
        """What is said of the line; None where that is too old."""
        known = self.known
        found = known.link()
        return None if found is None or known.is_stale(found) else found.value

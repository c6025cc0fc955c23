"""What the gateway knows of the aircraft: the newest value of every key it reads, and how old each is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import ControlEstimate, ControlStatus
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.navi import ControlNavi
from mkdaemon.telemetry.record import RecordStatus
from mkdaemon.telemetry.state import Altitude, Attitude, Battery, Flight, Gps, Pilot, Position, Velocity
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import CameraSetup, VisionPose

_Value = TypeVar("_Value")

READ: Final = (
    "state/*",
    "control/status",
    "control/estimate",
    "control/navi",
    "link/health",
    "health",
    "vision/*/pose",
    "vision/*/setup",
    "record/status",
)
"""Keys that are watched, without events; the last values are asked for at the start."""

FRESH: Final = 1.5
"""A value of a stream of the boards is shown until it is so old [s]; the slowest comes twice a second."""
SLOW: Final = 3.0
"""The same for what the daemon publishes once a second [s]."""
SIGHT: Final = 0.3
"""The same for a pose and for the estimate [s]: as long as a setpoint lives."""

LIMITS: Final[dict[type[Any], float]] = {
    Attitude: FRESH,
    Position: FRESH,
    Altitude: FRESH,
    Velocity: FRESH,
    Battery: FRESH,
    Gps: FRESH,
    Flight: FRESH,
    Pilot: FRESH,
    ControlStatus: SLOW,
    VehicleHealth: SLOW,
    LinkHealth: SLOW,
    ControlNavi: SLOW,
    ControlEstimate: SIGHT,
    VisionPose: SIGHT,
    CameraSetup: 30.0,
    RecordStatus: SLOW,
}
"""How long each kind of value is shown [s]."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A value, and when it was true.

    Attributes:
        value: the value.
        at: by the gateway's clock [s].
    """

    value: Any
    at: float


class Picture:
    """The newest values by their kind; what is older than `LIMITS` is not shown.

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
        self._seen: dict[type[Any], Seen] = {}

    def take(self, value: Any, at: float, age: float = 0.0) -> None:
        """Keep a value.

        Args:
            value: of a kind in `LIMITS`; others are left alone.
            at: when it came [s].
            age: how old it was then [s].
        """
        self.now = max(self.now, at)
        stamp = getattr(value, "stamp", None)
        if stamp is not None and age == 0.0:
            self._compare_clocks(stamp, at)
        if type(value) in LIMITS:
            self._seen[type(value)] = Seen(value, at - age)
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

        One reference for all heights, so that a place that is asked for at the height that was told is that height:
        the altitude of the GPS drifts by metres against the barometer that the NaviCtrl flies by.
        """
        here = self.get(Position)
        if here is None or here.altitude_above_start is None or self.ground is None:
            return None
        return self.ground + here.altitude_above_start

    def get(self, kind: type[_Value], limit: float | None = None) -> _Value | None:
        """The newest value of a kind; None where there is none, or it is too old.

        Args:
            kind: its class.
            limit: another limit than that of `LIMITS` [s].
        """
        seen = self._seen.get(kind)
        if seen is None or self.now - seen.at > (LIMITS[kind] if limit is None else limit):
            return None
        value: _Value = seen.value
        return value

    @property
    def link(self) -> LinkState | None:
        """What is said of the line."""
        health = self.get(LinkHealth)
        return None if health is None else health.state

"""What the gateway knows of the aircraft: the newest value of every key it reads, and how old each is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, TypeVar

from mkdaemon.telemetry.control import ControlEstimate, ControlStatus
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.navi import ControlNavi
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
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._seen: dict[type[Any], Seen] = {}

    def take(self, value: Any, at: float, age: float = 0.0) -> None:
        """Keep a value.

        Args:
            value: of a kind in `LIMITS`; others are left alone.
            at: when it came [s].
            age: how old it was then [s].
        """
        self.now = max(self.now, at)
        if type(value) in LIMITS:
            self._seen[type(value)] = Seen(value, at - age)

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

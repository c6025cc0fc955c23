"""The aircraft, its link and the holder of the lease, as one value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

from mkdaemon.client.samples import Sample

if TYPE_CHECKING:
    from mkdaemon.reading import Picture
    from mkdaemon.telemetry.control import ControlStatus
    from mkdaemon.telemetry.link import LinkHealth, LinkState
    from mkdaemon.telemetry.record import RecordStatus
    from mkdaemon.telemetry.state import Attitude, Battery, Flight, Gps, Pilot, Position, Velocity
    from mkdaemon.telemetry.vehicle import VehicleHealth

_Value = TypeVar("_Value")


class _Last(Generic[_Value]):
    """A typed last value as an attribute; its model is imported when it is first looked at."""

    def __init__(self, suffix: str) -> None:
        self._suffix = suffix

    def __get__(self, status: VehicleStatus, _: object) -> _Value | None:
        sample = status.samples.get(self._suffix)
        value: _Value | None = None if sample is None else sample.value
        return value


@dataclass(frozen=True)
class VehicleStatus:
    """Last values of everything that says how a vehicle is; None for what was never published.

    Attributes:
        vehicle: its name.
        samples: the values as they came, by key; each has its `age` [s].
    """

    vehicle: str
    samples: Mapping[str, Sample]

    health: ClassVar[_Last[VehicleHealth]] = _Last("health")
    """The vehicle's own signs of life."""
    link: ClassVar[_Last[LinkState]] = _Last("link/state")
    """The verdict on the line."""
    link_health: ClassVar[_Last[LinkHealth]] = _Last("link/health")
    """Round trips, losses and streams."""
    control: ClassVar[_Last[ControlStatus]] = _Last("control/status")
    """Lease, phase and reason."""
    attitude: ClassVar[_Last[Attitude]] = _Last("state/attitude")
    """Orientation."""
    position: ClassVar[_Last[Position]] = _Last("state/position")
    """Where it is."""
    velocity: ClassVar[_Last[Velocity]] = _Last("state/velocity")
    """How fast it is."""
    battery: ClassVar[_Last[Battery]] = _Last("state/battery")
    """Voltage, current, charge used."""
    gps: ClassVar[_Last[Gps]] = _Last("state/gps")
    """Satellites and fix."""
    flight: ClassVar[_Last[Flight]] = _Last("state/flight")
    """What the aircraft is doing."""
    pilot: ClassVar[_Last[Pilot]] = _Last("state/pilot")
    """What reaches the aircraft from the pilot."""

    recorder: ClassVar[_Last[RecordStatus]] = _Last("record/status")
    """What the daemon's own recorder does."""

    @property
    def is_alive(self) -> bool:
        """A board is heard."""
        health = self.samples.get("health")
        return health is not None and bool(health.fields["is_alive"])

    def age(self, suffix: str) -> float | None:
        """How old a value was when it was asked for [s]; None where there is none.

        Args:
            suffix: its key, for example `state/attitude`.
        """
        sample = self.samples.get(suffix)
        return None if sample is None else sample.age

    def picture(self) -> Picture:
        """What the values mean together when they were asked for; those that another version publishes are left out."""
        from mkdaemon.reading import Reading

        reading = Reading()
        for suffix, sample in self.samples.items():
            reading.take(suffix, sample.known, -(sample.age or 0.0))
        return reading.at(0.0)

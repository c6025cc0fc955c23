"""The lease and its stream of setpoints."""

from __future__ import annotations

from dataclasses import dataclass

from mkdaemon.config.control import LeaseConfig, LimiterConfig
from mkdaemon.telemetry.control import LeaseState
from mkdaemon.telemetry.setpoint import Setpoint


@dataclass(slots=True)
class Lease:
    """One client's right to fly.

    Attributes:
        holder: the client.
        epoch: number of the lease.
        ttl: life without a sign of life [s].
        sign_of_life: when the latest came: a setpoint or a renewal [s].
        since: since when its stream lives without a pause [s].
        arrived: when the newest setpoint did [s].
        newest: that setpoint; None before the first.
    """

    holder: str
    epoch: int
    ttl: float
    sign_of_life: float
    since: float
    arrived: float
    newest: Setpoint | None = None

    def shown(self, now: float) -> LeaseState:
        """Return the lease as the bus shows it."""
        left = max(0.0, self.sign_of_life + self.ttl - now)
        return LeaseState(holder=self.holder, epoch=self.epoch, ttl=self.ttl, left=left)

    def take_setpoint(self, setpoint: Setpoint, cfg: LeaseConfig, now: float) -> None:
        """Take the newest setpoint; after a pause the stream lives anew."""
        if self.newest is None or now - self.arrived > 1.0 / cfg.engage_rate:
            self.since = now
        self.sign_of_life = self.arrived = now
        self.newest = setpoint

    def setpoint_life(self, cfg: LimiterConfig) -> float:
        """Time the newest setpoint holds [s]."""
        assert self.newest is not None
        return min(self.newest.ttl, cfg.setpoint_ttl)

    def silence(self, now: float, *, is_in_flight: bool) -> float:
        """Time the holder has been silent [s]: setpoints count in flight, any sign of life before."""
        return now - (self.arrived if is_in_flight else self.sign_of_life)

    def is_live(self, cfg: LeaseConfig, now: float) -> bool:
        """Whether the stream has lived long enough to engage, and still does."""
        return now - self.arrived <= 1.0 / cfg.engage_rate and self.arrived - self.since >= cfg.engage_after

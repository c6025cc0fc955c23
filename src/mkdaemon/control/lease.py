"""The lease and its stream of setpoints."""

from __future__ import annotations

from dataclasses import dataclass
from hmac import compare_digest
from typing import Final

from mkdaemon.config.control import LeaseConfig, LimiterConfig
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import LeaseState
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import Setpoint

LONGEST_JUMP: Final = 10_000
"""Most that the sequence may grow from one setpoint to the next: 200 s of a stream at 50 Hz."""


@dataclass(slots=True)
class Lease:
    """One client's right to fly.

    Attributes:
        holder: the client.
        epoch: number of the lease; everybody may know it.
        secret: what only the holder knows.
        ttl: life without a sign of life [s].
        sign_of_life: when the latest came: a setpoint or a renewal [s].
        since: since when its stream lives without a pause [s].
        arrived: when the newest setpoint did [s].
        newest: that setpoint; None before the first.
        sequence: number of the last setpoint that its holder sent, taken or refused; None before the first.
    """

    holder: str
    epoch: int
    secret: str
    ttl: float
    sign_of_life: float
    since: float
    arrived: float
    newest: Setpoint | None = None
    sequence: int | None = None

    def shown(self, now: float) -> LeaseState:
        """Return the lease as the bus shows it."""
        left = max(0.0, self.sign_of_life + self.ttl - now)
        return LeaseState(holder=self.holder, epoch=self.epoch, ttl=self.ttl, left=left)

    def check_secret(self, secret: str) -> None:
        """Make sure that the holder asks.

        Raises:
            CommandRejectedError: `not_holder`.
        """
        if not compare_digest(secret.encode(), self.secret.encode()):
            raise self.not_holder()

    def not_holder(self) -> CommandRejectedError:
        """Why somebody else is refused."""
        return refuse(Token.NOT_HOLDER, holder=self.holder)

    def check_setpoint(self, setpoint: Setpoint) -> None:
        """Make sure that a setpoint is newer than the last one, and not unbelievably so.

        Raises:
            CommandRejectedError: `stale_sequence`, `sequence_jump`.
        """
        if self.sequence is None:
            return
        sequence, last = setpoint.sequence, self.sequence
        if sequence <= last:
            raise refuse(Token.STALE_SEQUENCE, sequence=sequence, last=last)
        if sequence - last > LONGEST_JUMP:
            raise refuse(Token.SEQUENCE_JUMP, sequence=sequence, last=last, limit=LONGEST_JUMP)

    def take_setpoint(self, setpoint: Setpoint, cfg: LeaseConfig, now: float) -> None:
        """Take the newest setpoint; after a pause the stream lives anew."""
        if self.newest is None or now - self.arrived > 1.0 / cfg.engage_rate:
            self.since = now
        self.sign_of_life = self.arrived = now
        self.newest, self.sequence = setpoint, setpoint.sequence

    def refuse_setpoint(self, setpoint: Setpoint, now: float, *, goes_on: bool) -> None:
        """Take note of a setpoint of the holder that was refused: it is spent, or a stranger could send it again.

        Args:
            setpoint: what was refused.
            now: when it arrived [s].
            goes_on: what is flown keeps its place, so it is flown on while its holder streams anything.
        """
        self.sign_of_life, self.sequence = now, setpoint.sequence
        if goes_on and self.newest is not None:
            self.arrived = now

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

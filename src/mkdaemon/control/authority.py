"""Who may fly, and what is sent because of it: one lease at a time, and the ladder from setpoint to release.

A pure state machine: every method takes `now` [s; monotonic] and nothing happens between calls. Frames of an old epoch
cannot leave: only `tick` hands out sticks, and it hands out those of the present lease. Source: docs/safety.md.
"""

from __future__ import annotations

from dataclasses import dataclass

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.limiter import Sticks
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import LeaseState, Phase
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import StickSetpoint


@dataclass(frozen=True, slots=True)
class Silent:
    """Send nothing."""


@dataclass(frozen=True, slots=True)
class Fly:
    """Send these sticks, through the limiter, which levels them when they are too old.

    Attributes:
        sticks: what the holder of the lease asked for [stick; FLU].
        age: time since it arrived [s].
        ttl: time it claims to hold [s].
        epoch: the lease.
        sequence: the setpoint's number.
    """

    sticks: Sticks
    age: float
    ttl: float
    epoch: int
    sequence: int


@dataclass(frozen=True, slots=True)
class LetGo:
    """Release the aircraft now, and say `released` when that is done.

    Attributes:
        reason: why, one sentence.
        holder: who lost the lease.
        asked: somebody asked for it, so it is no failsafe.
    """

    reason: str
    holder: str
    asked: bool


Action = Silent | Fly | LetGo


@dataclass(slots=True)
class _Lease:
    """The lease and its stream of setpoints: since when it lives, when the newest arrived."""

    holder: str
    epoch: int
    ttl: float
    sign_of_life: float
    since: float
    arrived: float
    newest: StickSetpoint | None = None

    def shown(self, now: float) -> LeaseState:
        left = max(0.0, self.sign_of_life + self.ttl - now)
        return LeaseState(holder=self.holder, epoch=self.epoch, ttl=self.ttl, left=left)


class Authority:
    """The lease and the phase it is in."""

    def __init__(self, cfg: ControlConfig, *, first_epoch: int) -> None:
        """Start with nobody flying.

        Args:
            cfg: times and bands.
            first_epoch: epoch of the first lease; must be above every epoch of an earlier run of the daemon, so that
                nothing a client still streams from before is applied.
        """
        self._cfg = cfg
        self._next_epoch = first_epoch
        self._lease: _Lease | None = None
        self._pending: LetGo | None = None
        self.phase = Phase.FREE
        self.reason = "nobody has taken the lease"
        self.refused = 0

    def lease(self, now: float) -> LeaseState | None:
        """The present lease as the bus shows it; None for nobody."""
        return None if self._lease is None else self._lease.shown(now)

    def setpoint_age(self, now: float) -> float | None:
        """Age of the setpoint in use [s]; None where there is none."""
        return None if self._lease is None or self._lease.newest is None else now - self._lease.arrived

    def deadline(self) -> float | None:
        """When silence will change what is sent [s]; None while nothing is."""
        lease = self._lease
        if lease is None or lease.newest is None:
            return None
        if self.phase is Phase.FLYING:
            return lease.arrived + min(lease.newest.ttl, self._cfg.limiter.setpoint_ttl)
        return lease.arrived + self._cfg.lease.release_after if self.phase is Phase.STALE else None

    def take(self, holder: str, now: float, *, ttl: float | None = None, force: bool = False) -> LeaseState:
        """Give the lease to a client.

        Args:
            holder: its name.
            now: [s].
            ttl: life without a sign of life, if shorter than configured [s].
            force: take it from whoever holds it.

        Raises:
            CommandRejectedError: `lease_held`, `busy` (the aircraft is just being let go of).
        """
        present = self.lease(now)
        if present is not None and present.left > 0 and present.holder != holder and not force:
            raise refuse(Token.LEASE_HELD, holder=present.holder, left=present.left)
        if present is None and self.phase is Phase.RELEASING:
            raise refuse(Token.BUSY, detail="the aircraft is being let go of")
        if present is not None:
            self._end(f"{holder} took the lease from {present.holder}", asked=True)
        life = self._cfg.lease.ttl if ttl is None else min(ttl, self._cfg.lease.ttl)
        self._lease = _Lease(holder, self._next_epoch, life, sign_of_life=now, since=now, arrived=now)
        self._next_epoch += 1
        if self.phase is not Phase.RELEASING:
            self._enter(Phase.LEASED, f"{holder} holds the lease; waiting for a live, neutral stream")
        return self._lease.shown(now)

    def renew(self, epoch: int, now: float) -> LeaseState:
        """Give a sign of life without a setpoint.

        Raises:
            CommandRejectedError: `not_leased`, `wrong_epoch`.
        """
        lease = self._check(epoch)
        lease.sign_of_life = now
        return lease.shown(now)

    def give_back(self, epoch: int) -> None:
        """End the lease because its holder is done.

        Raises:
            CommandRejectedError: `not_leased`, `wrong_epoch`.
        """
        holder = self._check(epoch).holder
        self._end(f"{holder} gave the lease back", asked=True)

    def end(self, reason: str, *, asked: bool) -> None:
        """End the lease, whoever holds it, and let go of the aircraft, even if nobody holds it."""
        self._end(reason, asked=asked)

    def client_gone(self, holder: str) -> None:
        """Hear that a client died; ends the lease if it was the holder."""
        if self._lease is not None and self._lease.holder == holder:
            self._end(f"client {holder} is gone", asked=False)

    def offer(self, setpoint: StickSetpoint, now: float) -> bool:
        """Take a setpoint; the newest of the present lease wins.

        Returns:
            Whether it is the first of its epoch.

        Raises:
            CommandRejectedError: `not_leased`, `wrong_epoch`, `stale_sequence`.
        """
        try:
            lease = self._check(setpoint.epoch)
            if lease.newest is not None and setpoint.sequence <= lease.newest.sequence:
                raise refuse(Token.STALE_SEQUENCE, sequence=setpoint.sequence, last=lease.newest.sequence)
        except CommandRejectedError:
            self.refused += 1
            raise
        is_first = lease.newest is None
        if is_first or now - lease.arrived > 1.0 / self._cfg.lease.engage_rate:
            lease.since = now
        lease.sign_of_life = lease.arrived = now
        lease.newest = setpoint
        return is_first

    def tick(self, now: float) -> Action:
        """Decide what is sent now. `LetGo` comes once; nothing is sent until `released` answers it."""
        if self._pending is None and self._lease is not None and self.phase is not Phase.RELEASING:
            self._grow_old(self._lease, now)
        if self._pending is not None:
            order, self._pending = self._pending, None
            self._enter(Phase.RELEASING, order.reason)
            return order
        lease = self._lease
        if lease is None or lease.newest is None or self.phase is Phase.RELEASING:
            return Silent()
        if self.phase is Phase.LEASED and not self._may_engage(lease, lease.newest, now):
            return Silent()
        newest, age = lease.newest, now - lease.arrived
        if age > min(newest.ttl, self._cfg.limiter.setpoint_ttl):
            self._enter(Phase.STALE, "the setpoint is too old: neutral sticks")
        else:
            self._enter(Phase.FLYING, f"{lease.holder} flies")
        sticks = Sticks(newest.pitch, newest.roll, newest.yaw, newest.throttle)
        return Fly(sticks, age, newest.ttl, newest.epoch, newest.sequence)

    def released(self, now: float) -> None:
        """Hear that the release is done, or queued as the first bytes after the line comes back."""
        if self.phase is not Phase.RELEASING or self._pending is not None:
            return
        if self._lease is None:
            self._enter(Phase.FREE, self.reason)
        else:
            self._lease.sign_of_life = now
            self._enter(Phase.LEASED, f"{self._lease.holder} holds the lease; waiting for a live, neutral stream")

    def _check(self, epoch: int) -> _Lease:
        if self._lease is None:
            raise refuse(Token.NOT_LEASED)
        if epoch != self._lease.epoch:
            raise refuse(Token.WRONG_EPOCH, epoch=epoch, current=self._lease.epoch)
        return self._lease

    def _grow_old(self, lease: _Lease, now: float) -> None:
        """End a lease whose holder has fallen silent: setpoints count while it flies, any sign of life before."""
        flying = self.phase in {Phase.FLYING, Phase.STALE}
        silence = now - (lease.arrived if flying else lease.sign_of_life)
        if silence >= (self._cfg.lease.release_after if flying else lease.ttl):
            what = "setpoint" if flying else "sign of life"
            self._end(f"no {what} from {lease.holder} for {silence:.2f} s", asked=False)

    def _may_engage(self, lease: _Lease, newest: StickSetpoint, now: float) -> bool:
        """Whether the stream has lived long enough, lives, and its sticks are neutral."""
        cfg = self._cfg.lease
        if now - lease.arrived > 1.0 / cfg.engage_rate or lease.arrived - lease.since < cfg.engage_after:
            return False
        if max(abs(newest.pitch), abs(newest.roll), abs(newest.yaw)) > cfg.neutral_band:
            self.reason = f"{lease.holder} streams; waiting for neutral sticks"
            return False
        return True

    def _end(self, reason: str, *, asked: bool) -> None:
        holder = self._lease.holder if self._lease is not None else ""
        self._lease = None
        self._pending = LetGo(reason, holder, asked)

    def _enter(self, phase: Phase, reason: str) -> None:
        self.phase, self.reason = phase, reason

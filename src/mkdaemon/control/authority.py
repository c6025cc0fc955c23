"""Authority over the aircraft: one lease at a time, and the ladder from setpoint to release.

A pure state machine over the table of `modes`: every method takes `now` [s; monotonic] and nothing happens between
calls. Frames of an old epoch cannot leave: only `tick` hands out sticks, and it hands out those of the present lease.
Source: docs/safety.md.

The lease and its stream of setpoints.
"""

from __future__ import annotations

from dataclasses import dataclass
from hmac import compare_digest
from typing import Final

from mkdaemon.config.control import ControlConfig, LeaseConfig, LimiterConfig
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.manoeuvre import Step
from mkdaemon.control.modes import IN_FLIGHT, READY, Conditions, Reaction, Row, Trigger, find_row
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import NEVER_TAKEN, LeaseGrant, LeaseState, Outcome, Phase, Progress
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.signature import HolderKey

LONGEST_JUMP: Final = 10_000
"""Most that the sequence may grow from one setpoint to the next: 200 s of a stream at 50 Hz."""


@dataclass(slots=True)
class HeldLease:
    """One client's right to fly.

    Attributes:
        holder: the client.
        epoch: number of the lease; public.
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
        """Why another client is refused."""
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

    def take_setpoint(self, setpoint: Setpoint, cfg: LeaseConfig, now: float) -> bool:
        """Take the newest setpoint; after a pause a new stream starts. Returns whether it is the first."""
        is_first = self.newest is None
        if is_first or now - self.arrived > 1.0 / cfg.engage_rate:
            self.since = now
        self.sign_of_life = self.arrived = now
        self.newest, self.sequence = setpoint, setpoint.sequence
        return is_first

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


@dataclass(frozen=True, slots=True)
class Fly:
    """Send these sticks, through the limiter, which levels them when they are too old.

    Attributes:
        sticks: what the holder of the lease asked for [stick; FLU].
        age: time since it arrived [s].
        ttl: time it claims to hold [s].
        epoch: the lease.
        sequence: the setpoint's number.
        may_touch: the ground may be touched, see `Step.may_touch`.
        is_level: no client asked for this throttle, see `Step.is_level`.
    """

    sticks: Sticks
    age: float
    ttl: float
    epoch: int
    sequence: int
    may_touch: bool = False
    is_level: bool = False


@dataclass(frozen=True, slots=True)
class ReleaseOrder:
    """Release the aircraft now, and call `released` when that is done.

    Attributes:
        reason: why, one sentence.
        holder: the client that lost the lease; empty without one.
        asked: a client asked for it, so it is no failsafe.
    """

    reason: str
    holder: str
    asked: bool


Decision = Fly | ReleaseOrder | None
"""What is sent now; None for nothing."""


class Authority:
    """The lease and the phase it is in.

    Attributes:
        phase: where authority stands.
        reason: why, one sentence.
        aborts: asked for and done since the start.
        progress: what is flown, and how far it is; None while no setpoint's sticks are sent.
        outcome: how the last manoeuvre of the newest lease ended by itself; None while it has not.
    """

    def __init__(self, cfg: ControlConfig, *, first_epoch: int) -> None:
        """Start without a lease.

        Args:
            cfg: times and bands.
            first_epoch: epoch of the first lease; must be above every epoch of an earlier run of the daemon, so that
                nothing a client still streams from before is applied.
        """
        self._cfg = cfg
        self._next_epoch = first_epoch
        self._lease: HeldLease | None = None
        self._pending: ReleaseOrder | None = None
        self._may_begin = False
        self.phase = Phase.FREE
        self.reason = NEVER_TAKEN
        self.aborts = 0
        self.progress: Progress | None = None
        self.outcome: Outcome | None = None

    # -- what is known --------------------------------------------------------------------------------------------

    def lease(self, now: float) -> LeaseState | None:
        """Return the present lease as the bus shows it; None without one."""
        return None if self._lease is None else self._lease.shown(now)

    @property
    def newest(self) -> Setpoint | None:
        """The setpoint that the next tick is to decide by; None where it releases the aircraft, or none has come."""
        return None if self._lease is None or self._pending is not None else self._lease.newest

    def setpoint_age(self, now: float) -> float | None:
        """Return the age of the setpoint in use [s]; None where there is none."""
        return None if self._lease is None or self._lease.newest is None else now - self._lease.arrived

    def deadline(self) -> float | None:
        """Return when silence will change what is sent [s]; None while nothing is."""
        lease = self._lease
        if lease is None or lease.newest is None:
            return None
        if self.phase is Phase.FLYING:
            return lease.arrived + lease.setpoint_life(self._cfg.limiter)
        return lease.arrived + self._cfg.lease.release_after if self.phase in IN_FLIGHT else None

    # -- what clients ask for -------------------------------------------------------------------------------------

    def take(self, holder: str, secret: str, now: float, *, ttl: float | None = None) -> LeaseGrant:
        """Give the lease to a client, also if another one holds it; admission has decided before.

        Another client of the present holder's name is another client.

        Args:
            holder: its name.
            secret: known to this client only.
            now: [s].
            ttl: life without a sign of life, if shorter than configured [s].
        """
        if self._lease is not None:
            self.end(Trigger.LEASE_TAKEN_OVER, taker=holder)
        life = self._cfg.lease.ttl if ttl is None else min(ttl, self._cfg.lease.ttl)
        self._lease = HeldLease(holder, self._next_epoch, secret, life, sign_of_life=now, since=now, arrived=now)
        self._next_epoch += 1
        self.outcome = None
        self._move(Trigger.LEASE_TAKEN)
        return LeaseGrant(**self._lease.shown(now).__dict__, secret=secret)

    def renew(self, epoch: int, secret: str, now: float) -> LeaseState:
        """Take a sign of life without a setpoint; refused as `give_back` is."""
        lease = self._check(epoch)
        lease.check_secret(secret)
        lease.sign_of_life = now
        return lease.shown(now)

    def give_back(self, epoch: int, secret: str) -> None:
        """End the lease because its holder is done.

        Raises:
            CommandRejectedError: `not_leased`, `wrong_epoch`, `not_holder`.
        """
        self._check(epoch).check_secret(secret)
        self.end(Trigger.LEASE_RETURNED)

    def client_gone(self, holder: str) -> None:
        """End the lease if this client held it: the client died."""
        if self._lease is not None and self._lease.holder == holder:
            self.end(Trigger.CLIENT_GONE)

    def end(self, event: Trigger, *, can_land: bool = False, **words: str) -> None:
        """End the lease, if any, and release the aircraft at the next tick in any case.

        Args:
            event: what happened; nothing is done in a phase for which the table has no row.
            can_land: a target is in sight: where the table says so, the flight ends with a landing.
            words: what the reason of the row is filled in with.
        """
        row = find_row(self.phase, event, Conditions(is_held=self._lease is not None, can_land=can_land))
        if row is not None and row.reaction is Reaction.RELEASE:
            self._pending = self._release_order(row, **words)
        elif row is not None:
            self.phase, self.reason = row.target, self._reason(row, **words)

    def abort(self, cause: str) -> None:
        """Stop the manoeuvre; the lease goes on.

        Raises:
            CommandRejectedError: `nothing_flown`.
        """
        if self._move(Trigger.ABORT_REQUESTED, cause=cause) is None and self.phase is not Phase.ABORTED:
            raise refuse(Token.NOTHING_FLOWN, phase=self.reason)
        self.aborts += 1

    def refuse_setpoint(self, setpoint: Setpoint, now: float, *, goes_on: bool) -> None:
        """Take note that a setpoint of the holder was refused; see `HeldLease.refuse_setpoint`."""
        if self._lease is not None and self._lease.epoch == setpoint.epoch:
            self._lease.refuse_setpoint(setpoint, now, goes_on=goes_on)

    def is_resumed_by(self, setpoint: Setpoint | None) -> bool:
        """Whether a setpoint ends the newest abort."""
        return setpoint is not None and 0 < setpoint.after_abort == self.aborts

    def flown_phase(self, now: float) -> Phase:
        """The phase in which the newest setpoint is flown at a time [s]: an abort that it ends is over.

        So is a wait for an answer, in the tick after the one that found everything ready.
        """
        lease = self._lease
        if lease is None or not self._is_fresh(lease, now):
            return self.phase
        is_over = self.phase is Phase.ABORTED and self.is_resumed_by(lease.newest)
        return Phase.FLYING if is_over or (self.phase is Phase.UNANSWERED and self._may_begin) else self.phase

    @property
    def holder_key(self) -> HolderKey | None:
        """What identifies setpoints of the present holder; None without a lease."""
        return None if self._lease is None else HolderKey(self._lease.epoch, self._lease.secret, self._lease.holder)

    def refuse_unsigned(self, setpoint: Setpoint) -> CommandRejectedError:
        """Why a setpoint is refused that the holder did not sign: `not_leased`, `wrong_epoch`, `not_holder`."""
        try:
            return self._check(setpoint.epoch).not_holder()
        except CommandRejectedError as error:
            return error

    def check_setpoint(self, setpoint: Setpoint, signed_for: int) -> HeldLease:
        """Return the lease a setpoint stands on, which may take it.

        Args:
            setpoint: what is asked for.
            signed_for: epoch of the lease whose holder signed it.

        Raises:
            CommandRejectedError: `not_leased`, `wrong_epoch`, `not_holder`, `stale_sequence`, `sequence_jump`.
        """
        lease = self._check(setpoint.epoch)
        if signed_for != lease.epoch:
            raise lease.not_holder()
        lease.check_setpoint(setpoint)
        return lease

    # -- what happens ---------------------------------------------------------------------------------------------

    def tick(self, guided: Step | None, now: float, why: str = "") -> Decision:
        """Decide what is sent now. `ReleaseOrder` comes once; nothing is sent until `released` answers it.

        Args:
            guided: what is flown for `newest`; None where there is none.
            now: [s].
            why: what led to the end of a manoeuvre that fails now, in words; it is added to the reason.
        """
        is_in_flight = self.phase in IN_FLIGHT
        if guided is not None and is_in_flight and guided.end is not None:
            event = Trigger.GUIDANCE_LOST if guided.end.is_failure else Trigger.FLIGHT_FINISHED
            self.end(event, cause="; ".join(filter(None, (guided.end.words, why if guided.end.is_failure else ""))))
            self.outcome = guided.end.outcome
        if self._pending is not None:
            order, self._pending = self._pending, None
            self.phase, self.reason = Phase.RELEASING, order.reason
            return order
        self.progress, lease = None, self._lease
        if lease is None:
            return None
        words = {"silence": f"{lease.silence(now, is_in_flight=is_in_flight):.2f}"}
        words["obstacle"] = "" if guided is None else guided.obstacle
        conditions = self._judge(lease, guided, now)
        row, self._may_begin = self._move(Trigger.TICK, conditions, **words), READY.holds(conditions)
        if row is None or row.reaction is Reaction.NOTHING:
            return None
        if row.reaction is Reaction.RELEASE:
            self._lease = None
            return ReleaseOrder(self.reason, lease.holder, row.is_asked)
        assert lease.newest is not None
        assert guided is not None
        self.progress = Progress(guided.manoeuvre, guided.stage, guided.is_done)
        age, newest = now - lease.arrived, lease.newest
        ground = {"may_touch": guided.may_touch, "is_level": guided.is_level}
        return Fly(guided.sticks, age, newest.ttl, lease.epoch, newest.sequence, **ground)

    def released(self, now: float) -> None:
        """Note that the release is done, or queued as the first bytes after the line comes back."""
        owed = self._pending is not None
        row = self._move(Trigger.RELEASE_DONE, Conditions(is_held=self._lease is not None, is_release_owed=owed))
        if row is not None and row.target is Phase.LEASED and self._lease is not None:
            self._lease.sign_of_life = now

    # -- inside ---------------------------------------------------------------------------------------------------

    def _check(self, epoch: int) -> HeldLease:
        if self._lease is None:
            raise refuse(Token.NOT_LEASED)
        if epoch != self._lease.epoch:
            raise refuse(Token.WRONG_EPOCH, epoch=epoch, current=self._lease.epoch)
        return self._lease

    def _judge(self, lease: HeldLease, guided: Step | None, now: float) -> Conditions:
        """Gather what the guards of a tick look at."""
        cfg, is_in_flight = self._cfg, self.phase in IN_FLIGHT
        is_silent = lease.silence(now, is_in_flight=is_in_flight) >= (
            cfg.lease.release_after if is_in_flight else lease.ttl
        )
        if guided is None:
            return Conditions(is_held=True, is_silent=is_silent)
        return Conditions(
            is_held=True,
            is_silent=is_silent,
            is_live=lease.is_live(cfg.lease, now),
            is_ready=not guided.obstacle,
            is_fresh=self._is_fresh(lease, now),
            is_unanswered=guided.is_unanswered,
            resumes=self.is_resumed_by(lease.newest),
        )

    def _is_fresh(self, lease: HeldLease, now: float) -> bool:
        """Whether the newest setpoint of a lease still holds at a time [s]."""
        return lease.newest is not None and now - lease.arrived <= lease.setpoint_life(self._cfg.limiter)

    def _move(self, event: Trigger, conditions: Conditions | None = None, **words: str) -> Row | None:
        """Take the row of an event, if there is one."""
        row = find_row(self.phase, event, conditions or Conditions(is_held=self._lease is not None))
        if row is not None:
            self.phase, self.reason = row.target, self._reason(row, **words)
        return row

    def _release_order(self, row: Row, **words: str) -> ReleaseOrder:
        """End the lease. Its reason is published from now on; the phase changes with the next tick."""
        self.reason = self._reason(row, **words)
        holder = self._lease.holder if self._lease is not None else ""
        self._lease = None
        return ReleaseOrder(self.reason, holder, row.is_asked)

    def _reason(self, row: Row, **words: str) -> str:
        holder = self._lease.holder if self._lease is not None else ""
        return row.reason.format(**{"holder": holder, "reason": self.reason, **words})

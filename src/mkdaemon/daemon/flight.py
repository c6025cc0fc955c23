"""From setpoints to stick frames: the control tick, the lease, the release.

Setpoint out: Zenoh thread, `call_soon_threadsafe`, `Authority.offer` (newest wins), tick, limiter, translate,
`Link.send_setpoint` with a deadline. The tick runs at once when a setpoint arrives and at the control rate otherwise.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Final

from mkdaemon.bus.codec import decode_map, read_command, schema_name
from mkdaemon.bus.gateway import refused
from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.authority import Authority, Fly, LetGo
from mkdaemon.control.limiter import Sticks, count, limit
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.daemon.meeting import meet
from mkdaemon.daemon.preflight import check_gate
from mkdaemon.daemon.vitals import Vitals
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import ReleaseResult
from mkdaemon.telemetry.command import CommandResult, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlOutput, ControlStatus, LeaseState, Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Status, Token, refuse
from mkdaemon.telemetry.setpoint import StickSetpoint
from mkdaemon.translate import extern_control

SHORTEST_STEP: Final = 0.01
"""Stick frames are at least this far apart [s]: the boards lose frames beyond 100 Hz."""
JUST_AFTER: Final = 0.0002
"""A deadline has surely passed so long after it [s]."""
LONGEST_RELEASE: Final = 5.0
"""A release that takes longer than this counts as not confirmed [s]; the link needs 1.5 s at most."""
STATUS_PERIOD: Final = 1.0
"""Status is published at least this often [s]."""
IDLE_PERIOD: Final = 0.1
"""Time between two looks at the lease while nobody flies [s]."""
REFUSAL_PERIOD: Final = 1.0
"""Refused setpoints, and stick frames the line does not take, are reported at most this often [s]."""

LONGEST_QUEUE: Final = 0.1
"""A stick frame that could not be sent for this long is never sent [s]."""

_PATIENCE: Final = {
    LinkCondition.DOWN: 0.0,
    LinkCondition.ABSENT: 0.0,
    LinkCondition.MUTE: 0.15,
    LinkCondition.GARBAGE: 0.15,
}
"""How long a client keeps its lease on such a line [s]. Silence is told after 0.35 s; a radio that drops a burst of
packets and is heard again within half a second has lost no aircraft."""


class FlightControl:
    """Holds the authority and moves the sticks; everything runs on the loop."""

    def __init__(
        self,
        cfg: ControlConfig,
        link: Link,
        bus: Outlet,
        vitals: Vitals,
        audit: Audit,
        *,
        clock: Clock,
    ) -> None:
        self._cfg = cfg
        self._link = link
        self._bus = bus
        self._vitals = vitals
        self._audit = audit
        self._clock = clock
        start = clock.stamp()
        # Milliseconds since 1970: above every epoch of an earlier run, whatever a client still streams.
        self._authority = Authority(cfg, first_epoch=int(start.wall * 1000))
        self._wake = asyncio.Event()
        self._last = Sticks(0.0, 0.0, 0.0, cfg.limiter.hover_throttle)
        self._sent_at = float("-inf")
        self._told: tuple[Phase, str, int | None] | None = None
        self._told_at = float("-inf")
        self._refusal_told_at = float("-inf")
        self._unsent_told_at = float("-inf")
        self._release_waiters: list[asyncio.Future[ReleaseResult | None]] = []
        self._openings = 0
        self._nameless = 0
        self._bad_since: float | None = None
        self.ticks = 0

    @property
    def phase(self) -> Phase:
        """Where authority stands."""
        return self._authority.phase

    # -- what the bus brings --------------------------------------------------------------------------------------

    def stick_arrived(self, arrived: float, raw: bytes) -> None:
        """Take a streamed setpoint; one that is refused is counted and reported."""
        try:
            setpoint = read_command(StickSetpoint, raw)
            is_first = self._authority.offer(setpoint, arrived)
        except CommandRejectedError as error:
            self._setpoint_refused(arrived, raw, error)
            return
        if is_first:
            self._audit.command("setpoint/stick", setpoint.__dict__, CommandResult(status=Status.ACCEPTED))
        self._wake.set()

    def client_changed(self, name: str, is_here: bool) -> None:
        """A client showed or lost its liveliness token."""
        if not is_here:
            self._authority.client_gone(name)
            self._wake.set()

    async def lease(self, raw: bytes) -> CommandResult:
        """Answer `do/lease`.

        Raises:
            CommandRejectedError: see `Authority`; also `no_control`, `discovering`, `link_down`, `gate_shut` and
                `gate_constant`.
        """
        request = read_command(LeaseRequest, raw)
        if request.action == "take":
            await meet(self._link, self._vitals.link)
            if self._authority.lease(self._clock.now()) is None:  # who takes it over must not wait
                self._check_control()
                await check_gate(self._link, allow_constant=self._cfg.lease.allow_constant_gate)
        t = self._clock.now()
        match request.action:
            case "take":
                openings = self._check_control()
                granted: LeaseState | None = self._authority.take(
                    request.holder or self._name(), t, ttl=request.ttl, force=request.force
                )
                self._openings = openings
            case "renew":
                granted = self._authority.renew(-1 if request.epoch is None else request.epoch, t)
            case "release":
                self._authority.give_back(-1 if request.epoch is None else request.epoch)
                granted = None
            case _:
                granted = self._authority.lease(t)
        self._wake.set()
        reply: dict[str, Any] = {} if granted is None else dict(granted)
        return CommandResult(status=Status.ACCEPTED, reply=reply, reply_type=schema_name(LeaseState))

    def _name(self) -> str:
        """Name a client that gave none; never twice the same, or two of them would hold one lease."""
        self._nameless += 1
        return f"anonymous-{self._nameless}"

    async def release(self, raw: bytes) -> CommandResult:
        """Answer `do/release`: whoever asks, the aircraft is let go of.

        Raises:
            CommandRejectedError: the request cannot be read.
        """
        request = read_command(ReleaseRequest, raw)
        done: asyncio.Future[ReleaseResult | None] = asyncio.get_running_loop().create_future()
        self._release_waiters.append(done)
        self._authority.end(request.reason, asked=True)
        self._wake.set()
        result = await done
        if result is None:
            return refused(refuse(Token.TIMEOUT, board="fc", name="release", detail=f"no end in {LONGEST_RELEASE:g} s"))
        seen = result.status == "confirmed"
        status = Status.ACCEPTED if seen else Status.NOT_OBSERVABLE
        return CommandResult(status=status, reply=asdict(result), reply_type="ReleaseResult.v1")

    # -- the tick -------------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Tick for ever."""
        while True:
            await self._wait()
            self.ticks += 1
            before, t = self._authority.phase, self._clock.now()
            self._watch_line(t)
            action = self._authority.tick(t)
            self._note_phase(before)
            if isinstance(action, Fly):
                self._fly(action, t, engaging=before is Phase.LEASED)
            elif isinstance(action, LetGo):
                await self._let_go(action)
            self._publish_status()

    def _watch_line(self, t: float) -> None:
        """Without a board nobody flies, and not after a reopening either: what the board held is gone.

        Nor past a board that does not hear us: it lets go by itself, and must not obey again out of the blue.
        """
        state = self._vitals.link
        if state is None:
            return
        patience = {**_PATIENCE, LinkCondition.ONE_WAY: self._cfg.lease.release_after}.get(state.condition)
        if patience is None:
            self._bad_since = None
        elif self._bad_since is None:
            self._bad_since = t
        if self._authority.phase not in {Phase.LEASED, Phase.FLYING, Phase.STALE}:
            return
        is_gone = self._bad_since is not None and patience is not None and t - self._bad_since >= patience
        if is_gone or state.openings != self._openings:
            self._authority.end(f"the link is {state.condition.value}: {state.reason}", asked=False)

    async def _wait(self) -> None:
        """Until a setpoint arrives, it is time to repeat one, or one grows too old; never sooner than the boards can.

        A repetition so shortly before a deadline that what follows would have to wait for the boards is left out.
        """
        flying = self._authority.phase in {Phase.FLYING, Phase.STALE}
        # A repetition waits half a period longer than a client should, or it would delay the setpoint just behind it.
        until = self._clock.now() + (1.5 / self._cfg.rate if flying else IDLE_PERIOD)
        deadline = self._authority.deadline()
        if deadline is not None:
            until = deadline + JUST_AFTER if until > deadline - SHORTEST_STEP else until
        # Timers of some loops are early by up to half a millisecond.
        while not self._wake.is_set() and (left := until - self._clock.now()) > 0:
            with suppress(TimeoutError):
                async with asyncio.timeout(left):
                    await self._wake.wait()
        self._wake.clear()
        early = self._sent_at + SHORTEST_STEP - self._clock.now()
        if flying and early > 0:
            await asyncio.sleep(early)

    def _fly(self, order: Fly, t: float, *, engaging: bool) -> None:
        """One stick frame: limit, translate, hand to the line."""
        dialect, cfg = self._link.dialect, self._cfg.limiter
        if dialect.extern_control is None or dialect.extern_control_layout is None:
            self._authority.end(f"external control is not possible: {dialect.read_only_reason}", asked=False)
            self._wake.set()
            return
        if engaging:
            # Tilt starts from neutral; throttle starts where the client holds it, because less would drop the aircraft.
            self._last = Sticks(0.0, 0.0, 0.0, order.sticks.throttle)
            self._sent_at = t - 1.0 / self._cfg.rate
        ttl = min(order.ttl, cfg.setpoint_ttl)
        sticks = limit(
            order.sticks,
            self._last,
            age=order.age,
            ttl=ttl,
            dt=max(t - self._sent_at, SHORTEST_STEP),
            layout=dialect.extern_control_layout,
            cfg=cfg,
            throttle_cap=self._throttle_cap(t),
        )
        counts = count(sticks)
        message = extern_control(dialect.extern_control, counts)
        is_fresh = order.age <= ttl
        life = min(ttl - order.age, LONGEST_QUEUE) if is_fresh else LONGEST_QUEUE
        try:
            self._link.send_setpoint(message, deadline=t + life)
        except CommandRejectedError as error:
            if (
                error.token == "releasing"
            ):  # the line lets go, or waits for a dead-man: nobody flies, so nobody is told so
                self._authority.end(error.reason, asked=False)
                self._wake.set()
            if t - self._unsent_told_at >= REFUSAL_PERIOD:
                self._unsent_told_at = t
                self._audit.log("warning", f"stick frame not sent: {error}")
            return
        self._last, self._sent_at = sticks, t
        output = ControlOutput(
            stamp=self._clock.stamp(),
            epoch=order.epoch,
            sequence=order.sequence,
            age=order.age,
            **asdict(counts),
            limited=sticks != order.sticks,
        )
        self._bus.publish("control/output", output)

    def _throttle_cap(self, t: float) -> float | None:
        """Most throttle of a stale command: the pilot's where it is told, and never more than now on the ground."""
        caps = [self._vitals.pilot_throttle(t)]
        if not self._vitals.is_flying(t):
            caps.append(self._last.throttle)
        known = [cap for cap in caps if cap is not None]
        return min(known) if known else None

    async def _let_go(self, order: LetGo) -> None:
        """Release the aircraft and tell everybody how it went."""
        result: ReleaseResult | None = None
        with suppress(TimeoutError):
            async with asyncio.timeout(LONGEST_RELEASE), asyncio.TaskGroup() as tasks:
                alive = tasks.create_task(self._stay_alive(), name="control.release")
                result = await self._link.release(order.reason)
                alive.cancel()
        before = self._authority.phase
        self._authority.released(self._clock.now())
        self._note_phase(before)
        confirmed = {"confirmed": True, "unconfirmed": False, "not_sent": False}
        if not order.asked:
            released = None if result is None else confirmed.get(result.status)
            self._audit.failsafe("release", order.reason, released)
        waiters, self._release_waiters = self._release_waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(result)

    async def _stay_alive(self) -> None:
        """Count on while a release is under way: one nobody confirms takes 1.5 s, which is no stalled loop."""
        while True:
            await asyncio.sleep(IDLE_PERIOD)
            self.ticks += 1

    # -- what the bus is told -------------------------------------------------------------------------------------

    def _check_control(self) -> int:
        """Refuse a lease nobody could fly with; returns which opening of the port it stands on."""
        dialect, state = self._link.dialect, self._vitals.link
        if dialect.extern_control is None:
            raise refuse(Token.NO_CONTROL, detail=dialect.read_only_reason or "this firmware has no external control")
        if state is None or not self._link.is_up:
            condition = "absent" if state is None else state.condition.value
            raise refuse(Token.LINK_DOWN, state=condition, detail="" if state is None else state.reason)
        return state.openings

    def _note_phase(self, before: Phase) -> None:
        after = self._authority.phase
        if after is before:
            return
        self._audit.mode(before.value, after.value, self._authority.reason)
        if after is Phase.STALE:
            self._audit.failsafe("neutral", self._authority.reason)

    def _publish_status(self) -> None:
        stamp = self._clock.stamp()
        lease = self._authority.lease(stamp.monotonic)
        told = (self._authority.phase, self._authority.reason, lease.epoch if lease else None)
        if told == self._told and stamp.monotonic - self._told_at < STATUS_PERIOD:
            return
        self._told, self._told_at = told, stamp.monotonic
        status = ControlStatus(
            stamp=stamp,
            phase=self._authority.phase,
            reason=self._authority.reason,
            lease=lease,
            setpoint_age=self._authority.setpoint_age(stamp.monotonic),
            refused=self._authority.refused,
            external_control=self._link.dialect.extern_control_layout,
        )
        self._bus.publish("control/status", status)

    def _setpoint_refused(self, arrived: float, raw: bytes, error: CommandRejectedError) -> None:
        if arrived - self._refusal_told_at < REFUSAL_PERIOD:
            return
        self._refusal_told_at = arrived
        try:
            fields = decode_map(raw)
        except CommandRejectedError:
            fields = {"bytes": len(raw)}
        self._audit.command("setpoint/stick", fields, refused(error))

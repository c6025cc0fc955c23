"""The flight core: everything that decides whether and how the aircraft moves. Pure; driven with `now`.

It is told what happens (setpoints, requests, verdicts on the line, state values) and answers `tick` with actions, and
`next_time` with when to tick again. Setpoint out: `setpoint` (newest wins), `Authority.tick`, guidance, limiter,
`SendSticks`. Source of the rules: docs/safety.md; of the phases: docs/modes.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import Action, ReadGate, Release, SendSticks
from mkdaemon.control.authority import Authority, Fly, LetGo
from mkdaemon.control.limiter import Sticks, count, limit
from mkdaemon.control.modes import Event
from mkdaemon.control.patience import LinePatience
from mkdaemon.control.preflight import Gate, check_gate
from mkdaemon.control.reports import Reports
from mkdaemon.control.setpoints import GUIDANCE, Guidance, guidance_for
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, LeaseState, Obstacle, Phase, ReleaseOutcome
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import Setpoint

SHORTEST_STEP: Final = 0.01
"""Stick frames are at least this far apart [s]: the boards lose frames beyond 100 Hz."""
JUST_AFTER: Final = 0.0002
"""A deadline has surely passed so long after it [s]."""
IDLE_PERIOD: Final = 0.1
"""Time between two looks at the lease while nobody flies [s]."""
LONGEST_QUEUE: Final = 0.1
"""A stick frame that could not be sent for this long is never sent [s]."""

_IS_CONFIRMED: Final = {
    ReleaseOutcome.CONFIRMED: True,
    ReleaseOutcome.UNCONFIRMED: False,
    ReleaseOutcome.NOT_SENT: False,
    ReleaseOutcome.NOT_OBSERVABLE: None,
}
_IN_FLIGHT: Final = frozenset({Phase.FLYING, Phase.STALE})


class FlightCore:
    """Holds the authority and decides the sticks."""

    def __init__(
        self,
        cfg: ControlConfig,
        facts: VehicleFacts,
        *,
        first_epoch: int,
        guidance: Mapping[type[Setpoint], Guidance] = GUIDANCE,
    ) -> None:
        """Start with nobody flying.

        Args:
            cfg: times, bands and bounds.
            facts: what is known about the vehicle.
            first_epoch: see `Authority`.
            guidance: what turns each kind of setpoint into sticks.
        """
        self._cfg = cfg
        self._facts = facts
        self._guidance = guidance
        self._authority = Authority(cfg, first_epoch=first_epoch, guide=self._guide)
        self._reports = Reports(self._authority)
        self._patience = LinePatience(one_way=cfg.lease.release_after)
        self._line = ControlLine()
        self._last = Sticks(0.0, 0.0, 0.0, cfg.limiter.hover_throttle)
        self._sent_at = float("-inf")
        self._release: LetGo | None = None
        self._nameless = 0
        self._ticked_at = float("-inf")
        self._is_paced = False
        self._is_due = True

    @property
    def phase(self) -> Phase:
        """Where authority stands."""
        return self._authority.phase

    # -- what clients want ----------------------------------------------------------------------------------------

    def setpoint(self, setpoint: Setpoint, at: float) -> CommandRejectedError | None:
        """Take a streamed setpoint; the newest of the present lease wins.

        Returns:
            Why it was refused: `no_guidance`, `not_leased`, `wrong_epoch`, `stale_sequence`; None where it was taken.
        """
        try:
            guidance_for(setpoint, self._guidance)
            is_first = self._authority.offer(setpoint, at)
        except CommandRejectedError as error:
            self.setpoint_refused(setpoint.suffix, setpoint.__dict__, error, at)
            return error
        if is_first:
            self._reports.first_setpoint(setpoint)
        self._is_due = True
        return None

    def setpoint_refused(self, key: str, fields: dict[str, Any], error: CommandRejectedError, at: float) -> None:
        """Report a setpoint that was refused or could not be read; the next tick does, and none is due because of it.

        Args:
            key: where it came, without `mk/<vehicle>/`.
            fields: what it carried.
            error: why it was refused.
            at: [s].
        """
        self._reports.setpoint_refused(key, fields, error, at)

    def lease(self, request: LeaseRequest, at: float, *, gate: Gate | None = None) -> LeaseState | ReadGate | None:
        """Answer a request about the lease.

        Args:
            request: what a client asks for.
            at: [s].
            gate: what was read after the same request was answered with `ReadGate`.

        Returns:
            The lease as it is now, None for nobody; or `ReadGate`: read the gate and ask again.

        Raises:
            CommandRejectedError: see `Authority`; also `no_control`, `link_down`, `gate_shut` and `gate_constant`.
        """
        epoch = -1 if request.epoch is None else request.epoch
        granted: LeaseState | None = None
        match request.action:
            case "take":
                # Who takes the lease over must not wait for the gate to be read.
                if gate is None and self._authority.lease(at) is None:
                    self._check_control()
                    return ReadGate()
                if gate is not None:
                    check_gate(gate, allow_constant=self._cfg.lease.allow_constant_gate)
                openings = self._check_control()
                holder = request.holder or self._next_name()
                granted = self._authority.take(holder, at, ttl=request.ttl, force=request.force)
                self._patience.lease_taken(openings)
            case "renew":
                granted = self._authority.renew(epoch, at)
            case "release":
                self._authority.give_back(epoch)
            case _:
                granted = self._authority.lease(at)
        self._is_due = True
        return granted

    def release(self, request: ReleaseRequest) -> None:
        """End the lease and release the aircraft, whoever asks."""
        self._end(Event.RELEASE_REQUESTED, request.reason)

    def client_gone(self, name: str) -> None:
        """Note that a client lost its liveliness token."""
        self._authority.client_gone(name)
        self._is_due = True

    # -- what the line reports ------------------------------------------------------------------------------------

    def line_changed(self, line: ControlLine) -> None:
        """Note what the link can take now."""
        self._line = line

    def released(self, outcome: ReleaseOutcome | None, at: float) -> None:
        """Note how the release ended; None where it did not end in time."""
        self._authority.released(at)
        self._reports.phase_changed()
        order, self._release = self._release, None
        if order is not None and not order.asked:
            self._reports.released(order.reason, None if outcome is None else _IS_CONFIRMED[outcome])
        self._is_due = True

    # -- the tick -------------------------------------------------------------------------------------------------

    def next_time(self) -> float:
        """When to tick again [s]: at once after news, in time to repeat a setpoint, just after a deadline.

        Never sooner than the boards can take the next stick frame. A repetition so shortly before a deadline that what
        follows would have to wait for the boards is left out.
        """
        until = self._ticked_at
        if not self._is_due:
            # A repetition waits half a period longer than a client should, or it would delay the next setpoint.
            until += 1.5 / self._cfg.rate if self._is_paced else IDLE_PERIOD
            deadline = self._authority.deadline()
            if deadline is not None and until > deadline - SHORTEST_STEP:
                until = deadline + JUST_AFTER
        return max(until, self._sent_at + SHORTEST_STEP) if self._is_paced else until

    def tick(self, now: float) -> list[Action]:
        """Decide what is done now, in order."""
        self._ticked_at, self._is_due = now, False
        order: Action | None = None
        if self._release is None:
            self._watch_line(now)
            before = self._authority.phase
            decision = self._authority.tick(now)
            self._reports.phase_changed()
            if isinstance(decision, Fly):
                order = self._fly(decision, now, engaging=before is Phase.LEASED)
            elif isinstance(decision, LetGo):
                self._release, order = decision, Release(decision.reason)
        self._reports.status(self._line.layout, now)
        self._is_paced = self._authority.phase in _IN_FLIGHT
        return ([] if order is None else [order]) + self._reports.take()

    def _watch_line(self, now: float) -> None:
        """End the lease when the line has been unusable for too long, or is another opening of the port."""
        link = self._facts.link
        if link is None:
            return
        self._patience.watch(link, now)
        if self._authority.lease(now) is not None and self._patience.is_over(link, now):
            self._authority.end(Event.LINK_LOST, cause=f"{link.condition.value}: {link.reason}")

    def _guide(self, setpoint: Setpoint, now: float) -> Sticks:
        return guidance_for(setpoint, self._guidance)(setpoint, self._facts, now)

    def _fly(self, order: Fly, now: float, *, engaging: bool) -> SendSticks | None:
        """Limit the sticks and make a frame of them; None where the line does not take it."""
        line, cfg = self._line, self._cfg.limiter
        if line.layout is None:
            self._end(Event.CONTROL_IMPOSSIBLE, line.reason)
            return None
        if engaging:
            # Tilt starts from neutral; throttle starts where the client holds it, because less would drop the aircraft.
            self._last = Sticks(0.0, 0.0, 0.0, order.sticks.throttle)
            self._sent_at = now - 1.0 / self._cfg.rate
        if line.obstacle is not None:
            error = refuse(Token(line.obstacle.value), state="down", detail=line.reason)
            if line.obstacle in {Obstacle.RELEASING, Obstacle.UNCONFIRMED}:  # nobody flies then, so the lease ends
                self._end(Event.LINE_RELEASING, error.reason)
            self._reports.frame_not_sent(error, now)
            return None
        ttl = min(order.ttl, cfg.setpoint_ttl)
        sticks = limit(
            order.sticks,
            self._last,
            age=order.age,
            ttl=ttl,
            dt=max(now - self._sent_at, SHORTEST_STEP),
            layout=line.layout,
            cfg=cfg,
            throttle_cap=self._throttle_cap(now),
        )
        self._last, self._sent_at = sticks, now
        life = min(ttl - order.age, LONGEST_QUEUE) if order.age <= ttl else LONGEST_QUEUE
        is_limited = sticks != order.sticks
        return SendSticks(count(sticks), now + life, order.epoch, order.sequence, order.age, is_limited)

    def _throttle_cap(self, now: float) -> float | None:
        """Most throttle of a stale command: the pilot's where it is known, and never more than now on the ground."""
        caps = [self._facts.pilot_throttle(now)]
        if not self._facts.is_flying(now):
            caps.append(self._last.throttle)
        known = [cap for cap in caps if cap is not None]
        return min(known) if known else None

    # -- inside ---------------------------------------------------------------------------------------------------

    def _end(self, event: Event, cause: str) -> None:
        self._authority.end(event, cause=cause)
        self._is_due = True

    def _check_control(self) -> int:
        """Refuse a lease nobody could fly with; returns which opening of the port it stands on."""
        link = self._facts.link
        if self._line.layout is None:
            raise refuse(Token.NO_CONTROL, detail=self._line.reason or "this firmware has no external control")
        if link is None or not link.condition.is_usable:
            condition = LinkCondition.ABSENT if link is None else link.condition
            raise refuse(Token.LINK_DOWN, state=condition.value, detail="" if link is None else link.reason)
        return link.openings

    def _next_name(self) -> str:
        """Name a client that gave none; never twice the same, or two of them would hold one lease."""
        self._nameless += 1
        return f"anonymous-{self._nameless}"

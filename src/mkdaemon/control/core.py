"""The flight core: everything that decides whether and how the aircraft moves. Pure; driven with `now`.

It has one door: `feed` takes events (see `events`), `tick` answers with actions. A tick is a straight line of plain
values: `Situation`, `Step` of what is flown, `Decision` of authority, `SendSticks` of the output. Rules:
docs/safety.md, docs/modes.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control import events
from mkdaemon.control.actions import Action, ReleaseAircraft, SendSticks
from mkdaemon.control.activeset import UNREAD
from mkdaemon.control.admission.beginnings import Concern, NewManoeuvre, TakeLease
from mkdaemon.control.admission.rows import findings, is_ready, refusal, refusals
from mkdaemon.control.admission.situation import Situation
from mkdaemon.control.answers import AnswerWatch
from mkdaemon.control.authority import Authority, Decision, Fly, ReleaseOrder
from mkdaemon.control.causes import causes
from mkdaemon.control.estimator.model import Gap
from mkdaemon.control.estimator.values import ViewFault
from mkdaemon.control.events import DUE, NOTED, Event, Reply
from mkdaemon.control.flightwatch import FlightWatch
from mkdaemon.control.flown import Flown
from mkdaemon.control.manoeuvres.table import MANOEUVRES, Make
from mkdaemon.control.modes import IN_FLIGHT, Trigger
from mkdaemon.control.output import StickOutput
from mkdaemon.control.pacing import Pacing
from mkdaemon.control.preflight import Preflight
from mkdaemon.control.reports import Reports
from mkdaemon.control.sight import Sight, checked_view
from mkdaemon.control.vehicle import VehicleFacts, VehicleMemory
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Cause, ControlLine, Gains, LeaseState, Obstacle, Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.path import PathStored
from mkdaemon.telemetry.preflight import PreflightReport
from mkdaemon.telemetry.refusals import TOKENS, Token, refuse
from mkdaemon.telemetry.setpoint import PathSetpoint, Setpoint
from mkdaemon.telemetry.signature import HolderKey
from mkdaemon.telemetry.state import Attitude, Pilot
from mkdaemon.telemetry.vision import PoseRefusal

TROUBLE_AFTER: Final = 0.5
"""A flight by the target without a pose for longer is in trouble [s]: ordinary flights have no longer hole."""


class FlightCore:
    """Holds the authority and decides the sticks. Events come in by `feed`, actions come out of `tick`.

    Attributes:
        path_stored: what the newest path asks for; None before the first.
    """

    def __init__(
        self,
        cfg: ControlConfig,
        *,
        first_epoch: int,
        rows: Mapping[type[Setpoint], Make] = MANOEUVRES,
    ) -> None:
        """Start without a lease and without values.

        Args:
            cfg: times, bands and bounds.
            first_epoch: see `Authority`.
            rows: the manoeuvre of each kind of setpoint.
        """
        self._cfg = cfg
        facts = self._facts = VehicleMemory()
        self._sight = Sight(cfg.autopilot, cfg.limiter.hover_throttle)
        self._flown = Flown(cfg, self._sight, rows)
        self._authority = Authority(cfg, first_epoch=first_epoch)
        self._output = StickOutput(cfg, facts)
        self._reports = Reports(self._authority, self._output, facts)
        self._watch = FlightWatch(one_way=cfg.lease.release_after)
        self._preflight = Preflight(cfg, facts)
        self._release: ReleaseOrder | None = None
        self._nameless = 0
        self.path_stored: PathStored | None = None
        self._pacing = Pacing(cfg)
        self._line = ControlLine()
        self._handlers: Mapping[type[Event], Callable[[Any, float], Reply | None]] = {
            events.SetpointAccepted: self._setpoint_accepted,
            events.SetpointUnsigned: self._setpoint_unsigned,
            events.SetpointUnreadable: self._setpoint_unreadable,
            events.LeaseAsked: self._lease_asked,
            events.ReleaseAsked: lambda event, now: self._end(Trigger.RELEASE_REQUESTED, event.request.reason),
            events.AbortAsked: self._abort_asked,
            events.ClientGone: self._client_gone,
            events.PathUploaded: self._path_uploaded,
            events.StateValue: self._state_received,
            events.MotorsReported: lambda event, now: facts.motors_reported(event.are_running, now),
            events.FlightctrlReported: self._flightctrl_reported,
            events.MotorTestSent: lambda event, now: facts.motor_test_sent(now),
            events.ListChanged: lambda event, now: facts.list_changed(now),
            events.PoseSeen: self._pose_seen,
            events.SightRefused: self._sight_refused,
            events.EyeStats: self._eye_reported,
            events.CellsKnown: lambda event, now: facts.cells_known(event.cells),
            events.FreeDisk: lambda event, now: facts.disk_measured(event.free),
            events.ModelKnown: self._model_known,
            events.ActiveSetRead: self._active_set_read,
            events.LineChanged: self._line_changed,
            events.LinkVerdict: self._link_judged,
            events.LinkMeasured: self._link_measured,
            events.FrameSent: self._frame_sent,
            events.FrameConfirmed: self._frame_confirmed,
            events.FrameNotSent: lambda event, now: self._reports.frame_not_sent(event.error, now),
            events.GuardChanged: self._guard_changed,
            events.GuardActed: lambda event, now: self._end(Trigger.GUARD_ACTED, "no stick frame was written in time"),
            events.Released: self._released,
        }

    # -- events in ------------------------------------------------------------------------------------------------

    def feed(self, event: Event, now: float) -> Reply:
        """Take an event; the only way in.

        Args:
            event: what happened.
            now: when [s; monotonic].
        """
        try:
            reply = self._handlers[type(event)](event, now) or NOTED
        except CommandRejectedError as error:
            reply = Reply(refusal=error)
        if reply.is_due:
            self._pacing.hurry()
        return reply

    def _setpoint_accepted(self, event: events.SetpointAccepted, now: float) -> Reply:
        """Take a streamed setpoint; the newest of the present lease wins.

        Refused as in `Authority.check_setpoint` and `_admit`. What is refused in flight changes nothing: a
        manoeuvre that keeps its place is flown on, sticks and attitudes grow stale.
        """
        setpoint = event.setpoint
        # Who sent it comes first: a stranger's setpoint must not be reported as one that the holder got wrong.
        key, is_of_lease = self._authority.holder_key, False
        is_by_holder = key is not None and key.epoch == event.signed_for
        try:
            lease = self._authority.check_setpoint(setpoint, event.signed_for)
            is_of_lease = True
            self._sight.named = getattr(setpoint, "target", "")
            phase, resumes = self._authority.phase, self._authority.is_resumed_by(setpoint)
            self._admit(setpoint, Phase.FLYING if phase is Phase.ABORTED and resumes else phase, now)
            is_first = lease.take_setpoint(setpoint, self._cfg.lease, now)
        except CommandRejectedError as error:
            if is_of_lease:
                goes_on = self._authority.phase in IN_FLIGHT and self._flown.keeps_place
                self._authority.refuse_setpoint(setpoint, now, goes_on=goes_on)
            self._reports.setpoint_refused(setpoint.suffix, setpoint.__dict__, error, now, is_by_holder=is_by_holder)
            return Reply(refusal=error)
        if isinstance(setpoint, PathSetpoint):
            self._sight.paths.use(setpoint.path)
        if is_first:
            self._reports.first_setpoint(setpoint)
        return NOTED if self._pacing.is_by_images else DUE

    def _admit(self, setpoint: Setpoint, phase: Phase, now: float) -> None:
        """Refuse a setpoint that cannot be followed, `no_guidance`, or may not be flown now."""
        change = self._flown.change(setpoint, phase)
        if change is not None:
            wanted, before = change
            error = refusal(wanted, replace(self._seen(self.situation(now)), flown=before))
            if error is not None:
                raise error
            self._flown.admitted(wanted)

    def _setpoint_unsigned(self, event: events.SetpointUnsigned, now: float) -> Reply:
        """Refuse what the holder did not sign: `not_leased`, `wrong_epoch`, `not_holder`."""
        error = self._authority.refuse_unsigned(event.setpoint)
        self._reports.setpoint_refused(event.setpoint.suffix, event.setpoint.__dict__, error, now, is_by_holder=False)
        return Reply(refusal=error)

    def _setpoint_unreadable(self, event: events.SetpointUnreadable, now: float) -> Reply:
        self._reports.setpoint_refused(event.key, dict(event.fields), event.error, now, is_by_holder=event.is_by_holder)
        return Reply(refusal=event.error)

    def _lease_asked(self, event: events.LeaseAsked, now: float) -> Reply:
        """Answer a request about the lease; refused as in `Authority`, and with what a check before the lease found."""
        request, found = event.request, event.found
        epoch = -1 if request.epoch is None else request.epoch
        granted: LeaseState | None = None
        match request.action:
            case "take":
                # A take-over of the lease must not wait until the gate is read.
                is_to_be_read = found is None and self._authority.lease(now) is None
                if found is not None or is_to_be_read:
                    self._preflight.active_set = found or UNREAD
                if self._authority.phase not in IN_FLIGHT:
                    self._preflight.compute_loop()
                for error in refusals(TakeLease(holder=request.holder, force=request.force), self.situation(now)):
                    # A release that is under way may end while the set is read.
                    if not (is_to_be_read and error.token == Token.BUSY):
                        raise error
                if is_to_be_read:
                    return Reply(must_read_set=True)
                assert self._facts.link is not None
                holder = request.holder or self._next_name()
                granted = self._authority.take(holder, event.secret, now, ttl=request.ttl)
                self._watch.lease_taken(self._facts.link.openings)
            case "renew":
                granted = self._authority.renew(epoch, request.secret, now)
            case "release":
                self._authority.give_back(epoch, request.secret)
            case _:
                granted = self._authority.lease(now)
        return Reply(lease=granted, is_due=True)

    def _abort_asked(self, event: events.AbortAsked, now: float) -> Reply:
        """Stop the manoeuvre: hold where that is possible, else level; refused with `nothing_flown`."""
        self._authority.abort(event.request.reason)
        return DUE

    def _client_gone(self, event: events.ClientGone, now: float) -> Reply:
        self._authority.client_gone(event.name)
        return DUE

    def _path_uploaded(self, event: events.PathUploaded, now: float) -> Reply:
        """Store a path that can be flown; refused with `path_refused`."""
        self.path_stored = self._sight.paths.upload(event.request, self._sight.model)
        return NOTED

    def _state_received(self, event: events.StateValue, now: float) -> None:
        value = event.value
        self._facts.state_received(value, now)
        if isinstance(value, Attitude):
            self._sight.attitude_received(value)
            self._preflight.motion.attitude_received(now - self._sight.attitude_age, value.pitch, value.roll)
        elif isinstance(value, Pilot) and value.is_gate_open is not None:
            self._sight.answer.gate_reported(now, is_open=value.is_gate_open)

    def _flightctrl_reported(self, event: events.FlightctrlReported, now: float) -> None:
        self._facts.flightctrl_reported(is_lost=event.is_lost)
        self._line_changed(events.LineChanged(self._line), now)

    def _pose_seen(self, event: events.PoseSeen, now: float) -> Reply:
        pose = event.pose
        sight, view = self._sight, checked_view(pose, now)
        if isinstance(view, ViewFault):
            self._reports.pose_refused(pose, view, now)
            return NOTED
        current = self._flown.current
        lifted = None
        is_ours = pose.target in (sight.target, sight.named) or not sight.target
        if current is not None and is_ours and sight.may_follow(pose.target, view):
            lifted = current.height_seen(view.height, view.at, is_placed=view.is_placed)
        is_bound = self._authority.phase in IN_FLIGHT and self._flown.is_by_target
        may_change = not is_bound or (sight.is_standing and bool(sight.named))
        sight.seen(pose.target, view.at)
        before = sight.view_received(pose.target, view, now, lifted=lifted, may_change=may_change)
        if before:
            self._reports.target_changed(before, sight.target)
        self._preflight.pose_received(pose, sight.target, sight.contradicting)
        is_ours = pose.target == sight.target
        return DUE if self._pacing.image_taken(pose.stamp.monotonic, is_ours=is_ours) else NOTED

    def _sight_refused(self, event: events.SightRefused, now: float) -> Reply:
        self._facts.sight_refused(event.refused)
        is_poisoned = event.refused.refusal is PoseRefusal.MOTION and self._sight.discredit(event.refused.camera)
        return DUE if is_poisoned else NOTED

    def _eye_reported(self, event: events.EyeStats, now: float) -> None:
        self._facts.eye_reported(event.stats)
        self._reports.eyes_reported()

    def _model_known(self, event: events.ModelKnown, now: float) -> None:
        """Take the model; a read that failed under a lease, or that ends in flight, changes nothing."""
        has_failed = event.unknown is not None and event.unknown.gap is Gap.UNREAD
        if self.phase in IN_FLIGHT or self._is_read_again(has_failed):
            return
        self._sight.model_known(event.model)
        self._preflight.model_known(event.model, event.unknown)

    def _active_set_read(self, event: events.ActiveSetRead, now: float) -> None:
        if self.phase in IN_FLIGHT or self._is_read_again(not event.found.is_known):
            return
        self._preflight.active_set = event.found

    def _is_read_again(self, has_failed: bool) -> bool:
        """Whether a read failed after one, for the same lease, that did not."""
        return has_failed and self._preflight.active_set.is_known and self._authority.holder_key is not None

    def _line_changed(self, event: events.LineChanged, now: float) -> None:
        self._line = event.line
        self._preflight.line = self._output.line = self._facts.limit_line(event.line)

    def _frame_sent(self, event: events.FrameSent, now: float) -> None:
        self._output.frame_sent(event.number)
        self._sight.answer.frame_written(event.number, now)

    def _frame_confirmed(self, event: events.FrameConfirmed, now: float) -> None:
        self._output.frame_confirmed(event.number)
        self._sight.frame_confirmed(event.number, now)

    def _link_judged(self, event: events.LinkVerdict, now: float) -> None:
        before = self._facts.link
        if before is not None and before.condition is LinkCondition.ONE_WAY is not event.state.condition:
            self._sight.answer.line_heals()
        self._facts.link_changed(event.state)
        self._line_changed(events.LineChanged(self._line), now)

    def _link_measured(self, event: events.LinkMeasured, now: float) -> None:
        self._facts.link_measured(event.health)
        self._sight.link_measured(event.health)

    def _guard_changed(self, event: events.GuardChanged, now: float) -> None:
        """Without the guard no client gets a lease; the holder flies on."""
        self._preflight.has_guard = event.is_alive

    def _released(self, event: events.Released, now: float) -> Reply:
        self._authority.released(now)
        self._reports.phase_changed()
        order, self._release = self._release, None
        if order is not None and not order.asked:
            self._reports.released(order.reason, event.outcome)
        return DUE

    # -- questions, which change nothing --------------------------------------------------------------------------

    @property
    def phase(self) -> Phase:
        """Phase of control."""
        return self._authority.phase

    @property
    def is_in_air(self) -> bool:
        """Whether it is flown by the target, and nothing says that it may touch the ground."""
        return self.phase in IN_FLIGHT and self._flown.is_by_target and not self._flown.may_touch

    @property
    def vehicle(self) -> VehicleFacts:
        """What is known about the vehicle."""
        return self._facts

    @property
    def holder_key(self) -> HolderKey | None:
        """What identifies setpoints of the present holder; None without a lease."""
        return self._authority.holder_key

    def preflight(self, now: float) -> PreflightReport:
        """Every check before a flight; in flight, slow checks keep their last result."""
        if self.phase not in IN_FLIGHT:
            self._preflight.compute_loop()
        found = findings(replace(self.situation(now), stamps=self._preflight.compare(now)))
        return PreflightReport(is_ready=is_ready(found), findings=found)

    @property
    def answer(self) -> AnswerWatch:
        """Of the aircraft to its sticks."""
        return self._sight.answer

    def situation(self, now: float) -> Situation:
        """All that admission looks at, at a time [s]; who runs procedures adds the work that keeps the boards busy."""
        return self._preflight.situation(now, self.phase, self._authority.lease(now), self._flown, self._sight)

    def _seen(self, situation: Situation) -> Situation:
        """The same with what images show, for what is to begin: that costs a prediction, and milliseconds at times."""
        now = situation.now
        return replace(situation, entry=self._sight.entry(now), stamps=self._preflight.compare(now))

    def gains(self) -> Gains:
        """Model, gains and margins of the horizontal loop.

        Raises:
            CommandRejectedError: `loop_unstable`.
        """
        return self._preflight.gains()

    # -- the tick -------------------------------------------------------------------------------------------------

    def next_time(self) -> float:
        """When to tick again [s]; see `Pacing`."""
        return self._pacing.next_time(self._authority.deadline(), self._output.next_step, self._output.step)

    def tick(self, now: float, *, slept: float = 0.0) -> list[Action]:
        """Decide what to do now, in order. `slept`: suspend time since the last tick, not counted by the clock [s]."""
        stood_still = self._pacing.tick(now) + slept
        order: Action | None = None
        chain = self._causes(now)
        if self._release is None:
            before, decision = self.phase, self._decide(stood_still, chain, now)
            self._reports.phase_changed()
            if isinstance(decision, Fly):
                order = self._fly(decision, now, engaging=before is Phase.LEASED)
            elif isinstance(decision, ReleaseOrder):
                self._release, order = decision, ReleaseAircraft(decision.reason)
                self._flown.end()
        pose_age, exit_after = self._sight.pose_age(now), self._cfg.autopilot.exit_after
        self._reports.trouble(chain if self._needs_pose else (), pose_age, exit_after)
        self._reports.status(self._preflight.line.layout, self._watch.battery.warning, pose_age, now)
        self._pacing.sends(is_flying=self._authority.phase in IN_FLIGHT, is_by_images=self._is_by_images(now))
        return ([] if order is None else [order]) + self._reports.take()

    def _decide(self, stood_still: float, chain: tuple[Cause, ...], now: float) -> Decision:
        """From the situation to what is sent, after a time without a tick [s]; `chain` is why there is no pose."""
        authority, late = self._authority, self._flown.late_stage(now)
        if stood_still > self._cfg.limiter.setpoint_ttl and authority.phase in IN_FLIGHT:
            authority.end(Trigger.STALLED, cause=f"{stood_still:.2f}")
            late = ""
        situation = self._situation_of_step(now)
        ending = self._watch.look(situation, self._flown.concern)
        if ending is not None:
            authority.end(ending.trigger, cause=ending.cause, can_land=self._can_land(self._seen(situation)))
        elif late:
            self._end_stage(late)
            situation = self._situation_of_step(now)
        setpoint = authority.newest
        why = "; ".join(cause.text for cause in chain[1:]) if self._needs_pose else ""
        step = None if setpoint is None else self._flown.step(setpoint, authority.flown_phase(now), situation)
        return authority.tick(step, now, why)

    def _situation_of_step(self, now: float) -> Situation:
        """The situation, with the estimate where what is flown asks admission."""
        situation = self.situation(now)
        asks = self._authority.newest is not None and self._flown.asks(situation)
        return self._seen(situation) if asks else situation

    def _end_stage(self, stage: str) -> None:
        """Abort a flight whose stage has lasted for longer than it may; a landing for a low battery ends instead."""
        cause = f'"{stage}" takes too long'
        if self._authority.phase is Phase.LANDING:
            self._authority.end(Trigger.GUIDANCE_LOST, cause=cause)
        elif self._authority.phase.is_streamed:
            self._authority.abort(cause)

    def _is_by_images(self, now: float) -> bool:
        """Whether the sticks of this tick followed from what images show."""
        current = self._flown.current
        return current is not None and current.is_by_target and current.stepped_at == now

    @property
    def _needs_pose(self) -> bool:
        """Whether what is flown goes by images of the target."""
        return self.phase in IN_FLIGHT and self._flown.is_by_target and not self._flown.may_touch

    def _causes(self, now: float) -> tuple[Cause, ...]:
        """Why there is no pose; empty while there is one."""
        age, attitude = self._sight.pose_age(now), self._sight.attitude
        if age is None or age <= TROUBLE_AFTER:
            return ()
        silent = None if attitude is None else now - attitude.stamp.monotonic
        return causes(self._facts, pose_age=age, attitude_age=silent, now=now)

    def _can_land(self, situation: Situation) -> bool:
        """Whether a battery that is low is landed with: it cannot wait until entry conditions are met."""
        found = refusals(NewManoeuvre(Concern.LAND, target=self._sight.target), situation)
        return self._sight.is_fresh(situation.now) and all(error.token == Token.NOT_READY for error in found)

    def _fly(self, order: Fly, now: float, *, engaging: bool) -> SendSticks | None:
        """Make a stick frame; None where the line does not take it."""
        line = self._preflight.line
        if line.layout is None:
            self._end(Trigger.CONTROL_IMPOSSIBLE, line.reason)
            self._pacing.hurry()
            return None
        if engaging or line.obstacle is not None:
            self._output.engage(order.sticks, now)
        if line.obstacle is not None:
            error = refuse(TOKENS[line.obstacle.value], state="down", detail=line.reason)
            if line.obstacle in {Obstacle.RELEASING, Obstacle.UNCONFIRMED}:  # nothing can fly: the lease ends
                self._end(Trigger.LINE_RELEASING, error.reason)
                self._pacing.hurry()
            self._reports.frame_not_sent(error, now)
            return None
        hover = self._sight.hover_throttle(now)
        frame = self._output.make(
            order,
            line.layout,
            now,
            is_extra=self._pacing.answers_image,
            hover=hover,
            low_cell=self._preflight.active_set.low_cell,
        )
        self._sight.sticks_made(frame.counts, self._output.lid.use, now)
        self._reports.estimate(self._sight.estimate(now), self._flown.error)
        self._reports.path(self._flown.path, now)
        return frame

    def _end(self, event: Trigger, cause: str) -> Reply:
        self._authority.end(event, cause=cause)
        return DUE

    def _next_name(self) -> str:
        """Name a client that gave none; never twice the same, or two of them would hold one lease."""
        self._nameless += 1
        return f"anonymous-{self._nameless}"

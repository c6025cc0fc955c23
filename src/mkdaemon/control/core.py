"""The flight core: everything that decides whether and how the aircraft moves. Pure; driven with `now`.

It is told what happens (setpoints, requests, verdicts on the line, values) and answers `tick` with actions. Setpoint
out: `setpoint` (newest wins), `Authority.tick`, guidance, limiter, `SendSticks`. Rules: docs/safety.md, docs/modes.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import Action, ReadGate, Release, SendSticks
from mkdaemon.control.activeset import UNREAD, ActiveSet
from mkdaemon.control.authority import Authority
from mkdaemon.control.decisions import Fly, ReleaseOrder
from mkdaemon.control.estimator.model import AircraftModel, ModelUnknown
from mkdaemon.control.flightwatch import FlightWatch
from mkdaemon.control.modes import IN_FLIGHT, Event
from mkdaemon.control.output import StickOutput
from mkdaemon.control.pacing import Pacing
from mkdaemon.control.patience import LinePatience
from mkdaemon.control.preflight import Preflight
from mkdaemon.control.reports import Reports
from mkdaemon.control.setpoints import Guidance, Guided, guidance, guidance_for, landing_of
from mkdaemon.control.targetflight import ATTITUDE_LATENCY, TargetFlight
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, Gains, LeaseState, Obstacle, Phase, ReleaseOutcome
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.preflight import PreflightReport
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.signature import Signature
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import VisionPose


class FlightCore:
    """Holds the authority and decides the sticks.

    Attributes:
        facts: what is known about the vehicle.
        pacing: when it wants to tick.
        is_signed_by_holder: whether who holds the lease signed this; from any thread.
    """

    def __init__(
        self,
        cfg: ControlConfig,
        facts: VehicleFacts,
        *,
        first_epoch: int,
        known: Mapping[type[Setpoint], Guidance] | None = None,
    ) -> None:
        """Start with nobody flying.

        Args:
            cfg: times, bands and bounds.
            facts: what is known about the vehicle.
            first_epoch: see `Authority`.
            known: what turns each kind of setpoint into sticks; the product's own if none is given.
        """
        self._cfg = cfg
        self.facts = facts
        self._target = TargetFlight(cfg.autopilot, cfg.limiter.hover_throttle)
        self._guidance = guidance(self._target, cfg.lease.neutral_band) if known is None else known
        self._authority = Authority(cfg, first_epoch=first_epoch, guide=self._guide)
        self.is_signed_by_holder = self._authority.is_signed_by_holder
        self._output = StickOutput(cfg, facts)
        self._reports = Reports(self._authority, self._output, facts)
        self._patience = LinePatience(one_way=cfg.lease.release_after)
        self._watch = FlightWatch(self._authority, facts, self._patience, self._target.is_in_sight)
        self._preflight = Preflight(cfg, facts)
        self._release: ReleaseOrder | None = None
        self._nameless = 0
        self.pacing = Pacing(cfg)

    @property
    def phase(self) -> Phase:
        """Where authority stands."""
        return self._authority.phase

    # -- what clients want ----------------------------------------------------------------------------------------

    def setpoint(self, setpoint: Setpoint, at: float, signature: Signature) -> CommandRejectedError | None:
        """Take a streamed setpoint; the newest of the present lease wins, if the holder signed it.

        Returns:
            Why it was refused: `no_guidance`, `no_estimate`, `no_frame`, what a check before an autonomous flight
            found, and see `Authority.offer`; None where it was taken.
        """
        try:
            # Who sent it comes first: a stranger's setpoint must not be reported as one that the holder got wrong.
            self._authority.check_setpoint(setpoint, signature)
            guidance_for(setpoint, self._guidance).check(setpoint)
            if self._authority.phase not in IN_FLIGHT:
                self._preflight.check_setpoint(setpoint, at)
            is_first = self._authority.offer(setpoint, at, signature)
        except CommandRejectedError as error:
            self.setpoint_refused(setpoint.suffix, setpoint.__dict__, error, at)
            return error
        if is_first:
            self._reports.first_setpoint(setpoint)
        self.pacing.setpoint_taken()
        return None

    def setpoint_refused(self, key: str, fields: dict[str, Any], error: CommandRejectedError, at: float) -> None:
        """Report a setpoint that was refused; see `Reports.setpoint_refused`. No tick is due because of it."""
        self._reports.setpoint_refused(key, fields, error, at)

    def lease(
        self, request: LeaseRequest, at: float, *, found: ActiveSet | None = None
    ) -> LeaseState | ReadGate | None:
        """Answer a request about the lease.

        Args:
            request: what a client asks for.
            at: [s].
            found: what was read after the same request was answered with `ReadGate`.

        Returns:
            The lease now (`LeaseGrant` for who took it), None for nobody; or `ReadGate`: read it and ask again.

        Raises:
            CommandRejectedError: see `Authority`; also what a check before the lease found.
        """
        epoch = -1 if request.epoch is None else request.epoch
        granted: LeaseState | None = None
        match request.action:
            case "take":
                # Who takes the lease over must not wait for the gate to be read.
                is_to_be_read = found is None and self._authority.lease(at) is None
                if found is not None or is_to_be_read:
                    self._preflight.active_set = found or UNREAD
                self._preflight.require_lease(at)
                if is_to_be_read:
                    return ReadGate()
                assert self.facts.link is not None
                holder = request.holder or self._next_name()
                granted = self._authority.take(holder, at, ttl=request.ttl, force=request.force)
                self._patience.lease_taken(self.facts.link.openings)
            case "renew":
                granted = self._authority.renew(epoch, request.secret, at)
            case "release":
                self._authority.give_back(epoch, request.secret)
            case _:
                granted = self._authority.lease(at)
        self.pacing.hurry()
        return granted

    def release(self, request: ReleaseRequest) -> None:
        """End the lease and release the aircraft, whoever asks."""
        self._end(Event.RELEASE_REQUESTED, request.reason)

    def abort(self, request: AbortRequest) -> None:
        """Stop the manoeuvre, whoever asks: hold where that is possible, else level; the lease goes on.

        Raises:
            CommandRejectedError: `nothing_flown`.
        """
        self._authority.abort(request.reason)
        self.pacing.hurry()

    def client_gone(self, name: str) -> None:
        """Note that a client lost its liveliness token."""
        self._authority.client_gone(name)
        self.pacing.hurry()

    # -- what the boards and the cameras report -------------------------------------------------------------------

    def motors_reported(self, are_running: bool, at: float) -> None:
        """Take what a message says about the motors."""
        self.facts.motors_reported(are_running, at)

    def state_received(self, value: Telemetry, at: float) -> None:
        """Take a state value."""
        self.facts.state_received(value, at)
        if isinstance(value, Attitude):
            self._target.attitude_received(value)
            self._preflight.motion.attitude_received(at - ATTITUDE_LATENCY, value.pitch, value.roll)

    def pose_received(self, pose: VisionPose, at: float) -> None:
        """Take a pose of the vehicle against a target that arrives at a time [s]."""
        self.facts.pose_received(pose)
        self._target.pose_received(pose, at)
        self.pacing.image_taken(pose.stamp.monotonic, is_ours=pose.target == self._target.target)
        self._preflight.pose_received(pose, self._target.contradicting)

    def model_known(self, model: AircraftModel, unknown: ModelUnknown | None = None) -> None:
        """Take the model to fly by, and why it is not that of the aircraft's own parameter set; None where it is."""
        self._target.model_known(model)
        self._preflight.model_known(model, unknown)

    def preflight(self, now: float, found: ActiveSet | None = None) -> PreflightReport:
        """Make every check before a flight; with what the active set says, where it was read just now."""
        self._preflight.active_set = found or self._preflight.active_set
        return self._preflight.report(now, is_flying=self.phase in IN_FLIGHT)

    def gains(self) -> Gains:
        """Model, gains and margins of the horizontal loop."""
        return self._preflight.gains(is_flying=self.phase in IN_FLIGHT)

    # -- what the line reports ------------------------------------------------------------------------------------

    def line_changed(self, line: ControlLine) -> None:
        """Note what the link can take now."""
        self._preflight.line = self._output.line = self.facts.limit_line(line)

    def link_changed(self, state: LinkState) -> None:
        """Take a verdict on the line."""
        self.facts.link_changed(state)

    def frame_sent(self, number: int) -> None:
        """Note that a stick frame was written to the port."""
        self._output.frame_sent(number)

    def frame_confirmed(self, number: int) -> None:
        """Note that the board confirmed an external control frame."""
        self._output.frame_confirmed(number)

    def guard_changed(self, *, is_alive: bool) -> None:
        """Note whether the guard is there; without it nobody gets a lease, and who flies flies on."""
        self._preflight.has_guard = is_alive

    def guard_acted(self) -> None:
        """Note that the guard released the aircraft: whoever flew flies no more."""
        self._end(Event.GUARD_ACTED, "no stick frame was written in time")

    def released(self, outcome: ReleaseOutcome | None, at: float) -> None:
        """Note how the release ended; None where it did not end in time."""
        self._authority.released(at)
        self._reports.phase_changed()
        order, self._release = self._release, None
        if order is not None and not order.asked:
            self._reports.released(order.reason, outcome)
        self.pacing.hurry()

    # -- the tick -------------------------------------------------------------------------------------------------

    def next_time(self) -> float:
        """When to tick again [s]; see `Pacing`."""
        return self.pacing.next_time(self._authority.deadline(), self._output.next_step, self._output.step)

    def tick(self, now: float, *, slept: float = 0.0) -> list[Action]:
        """Decide what is done now, in order; the machine slept for so long since the last tick [s], uncounted."""
        stood_still = self.pacing.tick(now) + slept
        order: Action | None = None
        if self._release is None:
            if stood_still > self._cfg.limiter.setpoint_ttl and self._authority.phase in IN_FLIGHT:
                self._authority.end(Event.STALLED, cause=f"{stood_still:.2f}")
            self._watch.look(self._preflight.active_set, now)
            before = self._authority.phase
            decision = self._authority.tick(now)
            self._reports.phase_changed()
            if isinstance(decision, Fly):
                order = self._fly(decision, now, engaging=before is Phase.LEASED)
            elif isinstance(decision, ReleaseOrder):
                self._release, order = decision, Release(decision.reason)
        self._reports.status(self._preflight.line.layout, self._watch.battery.warning, now)
        self.pacing.sends(is_flying=self._authority.phase in IN_FLIGHT, is_by_images=self._target.guided_at == now)
        return ([] if order is None else [order]) + self._reports.take()

    def _guide(self, setpoint: Setpoint, now: float, is_flying: bool) -> Guided:
        if self._authority.phase is Phase.ABORTED:
            return self._target.stop(setpoint, self.facts, now)
        if self._authority.phase is Phase.LANDING:
            setpoint = landing_of(setpoint)
        guided = guidance_for(setpoint, self._guidance).guide(setpoint, self.facts, now, is_flying=is_flying)
        return self._preflight.wait_for_board(guided)

    def _fly(self, order: Fly, now: float, *, engaging: bool) -> SendSticks | None:
        """Make a stick frame; None where the line does not take it."""
        line = self._preflight.line
        if line.layout is None:
            self._end(Event.CONTROL_IMPOSSIBLE, line.reason)
            return None
        if engaging or line.obstacle is not None:
            self._output.engage(order.sticks, now)
        if line.obstacle is not None:
            error = refuse(Token(line.obstacle.value), state="down", detail=line.reason)
            if line.obstacle in {Obstacle.RELEASING, Obstacle.UNCONFIRMED}:  # nobody flies then, so the lease ends
                self._end(Event.LINE_RELEASING, error.reason)
            self._reports.frame_not_sent(error, now)
            return None
        frame = self._output.make(order, line.layout, now, is_extra=self.pacing.answers_image)
        self._target.sticks_made(frame.counts, now)
        self._reports.estimate(self._target.estimate(now), self._target.error)
        return frame

    def _end(self, event: Event, cause: str) -> None:
        self._authority.end(event, cause=cause)
        self.pacing.hurry()

    def _next_name(self) -> str:
        """Name a client that gave none; never twice the same, or two of them would hold one lease."""
        self._nameless += 1
        return f"anonymous-{self._nameless}"

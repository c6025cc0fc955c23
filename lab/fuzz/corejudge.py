"""What must never be, whatever happens around the flight core: every tick judged by docs/safety.md."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Final

from lab.fuzz.coretoy import HOVER
from lab.fuzz.coreworld import LONGEST_STEP, World
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import Action, PublishError, PublishEstimate, PublishStatus, ReleaseAircraft, SendSticks
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.manoeuvres.by_target import SEARCHES
from mkdaemon.control.manoeuvres.land import LONGEST_WAIT, LandingLimits, LandingPhase
from mkdaemon.control.manoeuvres.take_off import TakeOffLimits, TakeOffPhase
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, StickSetpoint

SLACK: Final = 3.0
"""Whole counts, error feedback, and the learnt hover throttle, above which nothing must lift standing feet [stick]."""
NOTICED: Final = 1.0
"""Nothing notices at once that the aircraft has come down by accident [s]."""
LATEST: Final = 0.06
"""The core may ask for its tick this much after a deadline [s]: the boards must be able to take the frame."""
LONGEST_LANDING: Final = LandingLimits().patience + LONGEST_WAIT + 10 * LONGEST_STEP
"""What a landing may wait for, without its way down [s]."""


class Breach(StrEnum):
    """What must never be."""

    EXCEPTION = "an exception, or a warning"
    LIMITS = "sticks beyond the limits of the configuration"
    NO_LEASE = "a stick frame that stands on no lease"
    NOT_NEUTRAL = "a setpoint is too old, and tilt or yaw are asked for"
    NOT_RELEASED = "a release was promised, and stick frames go on, or the core sleeps on past it"
    LIFTS = "feet that stand, no take-off, nobody's own sticks, and throttle above hover"
    ENDLESS = "a stage that does not end"
    UNTRUE = "what is reported is not what is flown"


class Judge:
    """Looks at every tick of one core.

    Attributes:
        breaches: what was found; the first few.
    """

    def __init__(self, world: World) -> None:
        self.breaches: list[str] = []
        self._world, self._cfg = world, world.cfg
        self._status: PublishStatus | None = None
        self._stage: tuple[str, float] = ("", 0.0)
        self._landing_until = math.inf
        self._longest = _longest_stages(world.cfg)

    def breach(self, what: Breach, seen: str) -> None:
        """Note what must not be."""
        if len(self.breaches) < MOST_BREACHES:
            self.breaches.append(f"{what.name} at {self._world.now:.2f} s: {seen}")

    def look(self, actions: list[Action]) -> None:
        """Judge what one tick decided."""
        world, frame, error, image_age = self._world, None, None, math.inf
        world.reached["tick"] += 1
        is_released = False
        for action in actions:
            match action:
                case SendSticks():
                    frame = action
                case ReleaseAircraft():
                    is_released = True
                case PublishStatus():
                    self._status = action
                case PublishError():
                    error = action.value
                case PublishEstimate():
                    image_age = action.value.image_age
                case _:
                    pass
        self._look_at_release(is_released=is_released, sends=frame is not None)
        status = self._status
        if status is not None:
            self._look_at_status(status)
        if frame is not None and status is not None:
            self._look_at_frame(frame, status)
            if error is not None and image_age <= self._cfg.autopilot.freeze_after:
                self._look_at_goal(error.manoeuvre, error.goal, status)

    def _look_at_release(self, *, is_released: bool, sends: bool) -> None:
        """A release that is promised comes with the next tick, and nothing is sent until it has ended."""
        world, is_releasing = self._world, self._world.releasing_until < math.inf
        if sends and (is_releasing or world.must_release):
            self.breach(Breach.NOT_RELEASED, "a stick frame, and a release is under way or was promised")
        if not is_releasing:
            if world.must_release and not is_released:
                self.breach(Breach.NOT_RELEASED, "a release was promised, and none came")
            world.must_release = False
        if self._world.core.phase.is_in_flight:
            deadline, asked = world.heard + self._cfg.lease.release_after, world.core.next_time()
            if world.core.phase is Phase.FLYING:
                deadline = world.heard + self._cfg.limiter.setpoint_ttl
            if asked > max(deadline, world.now) + LATEST:
                self.breach(Breach.NOT_RELEASED, f"the core sleeps until {asked:.2f} s, past {deadline:.2f} s")

    def _look_at_frame(self, frame: SendSticks, status: PublishStatus) -> None:
        world, limits, (pitch, roll, yaw, throttle) = self._world, self._cfg.limiter, frame.counts
        phase, kind = world.core.phase, status.manoeuvre or ""
        world.reached["in flight"] += 1
        tilts = abs(pitch) <= limits.max_pitch and abs(roll) <= limits.max_roll and abs(yaw) <= limits.max_yaw
        if not tilts or not limits.min_throttle <= throttle <= limits.max_throttle:
            self.breach(Breach.LIMITS, str(frame.counts))
        key = world.core.holder_key
        if key is None or frame.epoch != key.epoch or frame.epoch != world.epoch:
            self.breach(Breach.NO_LEASE, f"epoch {frame.epoch}, the lease that was taken last has {world.epoch}")
        if frame.age > limits.setpoint_ttl and (pitch, roll, yaw) != (0, 0, 0):
            self.breach(Breach.NOT_NEUTRAL, f"{frame.age:.2f} s old: {frame.counts}")
        if world.now - world.heard > self._cfg.lease.release_after:
            self.breach(Breach.NOT_RELEASED, f"silent for {world.now - world.heard:.2f} s")
        is_fresh = frame.age <= limits.setpoint_ttl
        is_asked = kind == "takeoff" or (kind in ("stick", "attitude") and is_fresh)
        hover = max(world.core.situation(world.now).hover_gas, HOVER) - GAS_CENTRE
        if world.now - world.toy.stood_since > NOTICED and not is_asked and throttle > hover + SLACK:
            self.breach(Breach.LIFTS, f"{kind} {status.stage}: {throttle} > {hover:.0f}")
        newest = world.newest
        if newest is None or frame.sequence != newest.sequence:
            self.breach(Breach.UNTRUE, f"setpoint {frame.sequence} is flown, {newest} was taken last")
        elif isinstance(newest, StickSetpoint) and phase is Phase.FLYING and is_fresh:
            asked = (newest.pitch, newest.roll, newest.yaw, newest.throttle)
            if frame.wanted is not None and tuple(frame.wanted) != asked:
                self.breach(Breach.UNTRUE, f"{asked} was asked for, {frame.wanted} is flown")

    def _look_at_goal(self, manoeuvre: str, goal: Sequence[float], status: PublishStatus) -> None:
        """What is flown to is what was asked for, and reported."""
        newest = self._world.newest
        if manoeuvre != status.manoeuvre:
            self.breach(Breach.UNTRUE, f"{status.manoeuvre} is reported, the goal is one of {manoeuvre}")
        elif self._world.core.phase is Phase.FLYING and isinstance(newest, PositionSetpoint):  # noqa: SIM102
            if math.dist(goal, newest.position) > 1e-6:
                self.breach(Breach.UNTRUE, f"{newest.position} was asked for, the goal is {goal}")

    def _look_at_status(self, status: PublishStatus) -> None:
        world, phase = self._world, self._world.core.phase
        reached = world.reached
        reached[f"phase {phase}"] += 1
        reached[f"manoeuvre {status.manoeuvre}"] += 1
        reached[f"stage {status.stage}"] += 1
        reached[f"outcome {status.outcome}"] += 1
        for cause in status.causes:
            reached[f"cause {cause.kind}"] += 1
        if phase is Phase.FLYING:
            if world.is_aborted:
                self.breach(Breach.UNTRUE, "aborted, and flown")
            if world.newest is not None and status.manoeuvre not in (None, world.newest.kind):
                self.breach(Breach.UNTRUE, f"{status.manoeuvre} is flown, {world.newest.kind} was taken last")
        if status.reason.endswith("takes too long"):  # the core aborts what does not end, and its client reads so
            world.aborts, world.is_aborted = status.aborts, phase is Phase.ABORTED
        if phase is Phase.ABORTED and status.manoeuvre not in (None, "hold", "level") and status.stage not in BLIND:
            self.breach(Breach.UNTRUE, f"aborted, and {status.manoeuvre} is flown: {status.stage}")
        if status.phase is not phase or status.aborts != world.aborts:
            self.breach(Breach.UNTRUE, f"{status.phase}, {status.aborts} aborts; it is {phase}, {world.aborts} aborts")
        if status.stage != self._stage[0] or not phase.is_in_flight:
            self._stage = status.stage, world.now
        lands = phase.is_in_flight and phase is not Phase.UNANSWERED and status.manoeuvre == "land"
        if not lands:
            self._landing_until = math.inf
        elif self._landing_until == math.inf:
            self._landing_until = world.now + LONGEST_LANDING + world.toy.place[2] / LandingLimits().slow_sink
        lasts = world.now - self._stage[1]
        if lasts > self._longest.get(status.stage, math.inf):
            self.breach(Breach.ENDLESS, f"{status.stage} for {lasts:.1f} s")
        if world.now > self._landing_until:
            self.breach(Breach.ENDLESS, f"a landing for more than {LONGEST_LANDING:.0f} s: {status.stage}")


BLIND: Final = (LandingPhase.COMMIT, LandingPhase.DOWN, TakeOffPhase.IDLE, TakeOffPhase.RAMP, TakeOffPhase.FAILED)
"""Stages that an abort does not change: they end by themselves."""
MOST_BREACHES: Final = 5
"""Kept of a sequence."""


def _longest_stages(cfg: ControlConfig) -> dict[str, float]:
    """How long a stage may last in which nothing is waited for [s]."""
    off, pilot = TakeOffLimits(), cfg.autopilot
    ramp = off.rises_for(cfg.limiter.hover_throttle + GAS_CENTRE) + off.blind
    spare = 4 * LONGEST_STEP
    return {
        TakeOffPhase.IDLE: pilot.takeoff_ready + spare,
        TakeOffPhase.RAMP: ramp + spare,
        TakeOffPhase.FAILED: off.cut + spare,
        LandingPhase.COMMIT: 6.0,
        LandingPhase.DOWN: pilot.stand_time + spare,
        SEARCHES: pilot.exit_after - pilot.search_after + spare,
    }

"""The manoeuvre that is flown: begun, changed, aborted, and what may take its place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.admission.beginnings import Concern, NewManoeuvre
from mkdaemon.control.admission.rows import refusal, waits_for
from mkdaemon.control.admission.situation import Situation
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.land import Land
from mkdaemon.control.manoeuvres.level import Level
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step, ended, level_at
from mkdaemon.control.manoeuvres.table import Make
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.control import ErrorValue, Outcome, Phase
from mkdaemon.telemetry.path import PathProgress
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import Setpoint

DOUBTED: Final = math.radians(12.0)
"""Largest tilt asked of an aircraft that may not answer [rad]: it shows whether it does, and a gate that is opened lets
no more through."""


class Flown:
    """Holds the one manoeuvre that is flown, or would be.

    Attributes:
        current: it; None before the first setpoint.
        error: how far the aircraft was from its goal at the last step; None without a goal.
        path: how far it was along its path then; None without one.
        may_touch: what is flown may touch the ground, see `Step.may_touch`.
    """

    def __init__(self, cfg: ControlConfig, sight: Sight, rows: Mapping[type[Setpoint], Make]) -> None:
        """Fly nothing yet.

        Args:
            cfg: bands and limits.
            sight: the target that is followed.
            rows: every manoeuvre by its kind of setpoint.
        """
        self.current: Manoeuvre | None = None
        self.error: ErrorValue | None = None
        self.path: PathProgress | None = None
        self.may_touch = False
        self._cfg, self._sight, self._rows = cfg, sight, rows
        self._phase: Phase | None = None
        self._left: Manoeuvre | None = None
        self._timed: Manoeuvre | None = None
        self._admitted: NewManoeuvre | None = None
        self._stage, self._stage_since, self._longest = "", 0.0, 0.0

    # -- at the door ----------------------------------------------------------------------------------------------

    def change(self, setpoint: Setpoint, phase: Phase) -> tuple[NewManoeuvre, Concern | None] | None:
        """The beginning that a setpoint needs from admission; None if it continues as admitted.

        Raises:
            CommandRejectedError: `no_guidance`: it cannot be followed.
        """
        if type(setpoint) not in self._rows:
            known = ", ".join(sorted(each.suffix for each in self._rows))
            raise refuse(Token.NO_GUIDANCE, name=setpoint.suffix, known=known)
        wanted, before = NewManoeuvre.by(setpoint), self.concern if phase.is_streamed else None
        if before is wanted.concern and wanted == self._admitted:
            return None
        # Where it is not flown it only has to be one that could be.
        return wanted, wanted.concern if phase.is_in_flight and not phase.is_streamed else before

    def admitted(self, wanted: NewManoeuvre) -> None:
        """Take what admission let pass."""
        self._admitted = wanted

    @property
    def concern(self) -> Concern | None:
        """The present manoeuvre for admission; None before the first setpoint."""
        if self.current is None:
            return None
        return Concern.ATTITUDE if isinstance(self.current, Level) else Concern(self.current.kind)

    @property
    def keeps_place(self) -> bool:
        """Whether what is flown goes on by itself while its holder streams what is refused."""
        return self.current is not None and self.current.keeps_place

    @property
    def is_by_target(self) -> bool:
        """Whether what is flown follows what images of the target show."""
        return self.current is not None and self.current.is_by_target

    # -- the tick -------------------------------------------------------------------------------------------------

    def asks(self, now: Situation) -> bool:
        """Whether the next step asks admission: before a flight, at an abort, and without an answer to the sticks."""
        is_aborted = now.phase is Phase.ABORTED is not self._phase
        return now.phase not in IN_FLIGHT or now.phase is Phase.UNANSWERED or is_aborted or bool(now.unanswered)

    def step(self, setpoint: Setpoint, phase: Phase, situation: Situation) -> Step:
        """Decide the sticks for the newest setpoint in a phase of authority, in a situation."""
        before, self._phase = self._phase, phase
        if phase not in IN_FLIGHT:
            step = self._prepare(setpoint, situation)
        elif phase is Phase.UNANSWERED or (self.is_by_target and not self.may_touch and situation.unanswered):
            step = self._wait(setpoint, phase, situation)
        else:
            self._left = None
            self._sight.leave_to_pilot(is_his=False)
            step = self._fly(setpoint, before, phase, situation)
            self._time(step, situation.now)
            if self.is_by_target:
                step = replace(step, sticks=self._bounded(step, situation))
        self.error, self.path, self.may_touch = step.error, step.path, step.may_touch
        self._sight.stand(is_standing=step.stands)
        is_flown = phase in IN_FLIGHT and (phase is Phase.UNANSWERED or self.is_by_target)
        self._sight.judge_answer(says_something=is_flown and not step.may_touch)
        return step

    def _bounded(self, step: Step, situation: Situation) -> Sticks:
        """What a flight by its target may ask for: little tilt without an answer, no lift of an aircraft that stands.

        One that has come down by accident, because the pilot's throttle or stopped motors let it sink, must not go up
        by itself: only a take-off leaves the ground.
        """
        sight, sticks = self._sight, step.sticks
        if sight.answer.is_doubted:
            tilt = sight.model.rad_per_count * math.hypot(sticks.pitch, sticks.roll)
            share = min(1.0, DOUBTED / max(tilt, 1e-9))
            sticks = sticks._replace(pitch=sticks.pitch * share, roll=sticks.roll * share)
        if step.may_touch or not (sight.has_come_down or situation.grounded):
            return sticks
        return sticks._replace(throttle=min(sticks.throttle, level_at(sight.carrying_gas).throttle))

    def _time(self, step: Step, now: float) -> None:
        """Note how long a stage lasts that is not done."""
        stage, self._longest = "" if step.is_done else step.stage, step.longest
        is_timed_whole = self.current is not None and self.current.is_timed_whole
        goes_on = stage == self._stage or (is_timed_whole and bool(stage))
        if self._timed is not self.current or not goes_on:
            self._stage_since = now
        self._stage, self._timed = stage, self.current

    def late_stage(self, now: float) -> str:
        """The stage that has lasted for longer than it may; empty for none."""
        return self._stage if now - self._stage_since > self._longest else ""

    def _wait(self, setpoint: Setpoint, phase: Phase, situation: Situation) -> Step:
        """Level, and ready to go on where the aircraft is as soon as it answers and is seen.

        Nothing that was learnt from sticks that did not act is kept.
        """
        if self._left is None:
            self._left, self._stage = self.current, ""
            self._sight.leave_to_pilot(is_his=True)
        now, after = situation.now, self._resumed(setpoint, phase)
        wanted = NewManoeuvre.by(setpoint)
        if (after.is_by_target and phase is not Phase.UNANSWERED) or wanted.concern is Concern.TAKE_OFF:
            wanted = NewManoeuvre(Concern.HOLD, target=wanted.target)
        goes_on = after.is_by_target and self._left is not None and self._left.is_by_target
        if goes_on:
            wanted = replace(wanted, is_resumed=True, target=wanted.target or self._sight.target)
        entered = after.enter(self._left if after.is_by_target else None, now)
        obstacle = waits_for(wanted, replace(situation, flown=None)) or entered
        self.current, step = after, after.step(now, is_flying=False)
        age = self._sight.pose_age(now)
        is_lost = after.is_by_target and (age is None or age > self._cfg.autopilot.exit_after)
        end = ended(Outcome.SIGHT_LOST, target=self._sight.target, age=age or 0.0) if is_lost else None
        sticks = level_at(self._sight.hover_gas)
        shown = replace(step, stage="", is_done=False, stands=False, is_unanswered=True, is_level=True)
        return replace(shown, sticks=sticks, obstacle=obstacle, end=end)

    def _resumed(self, setpoint: Setpoint, phase: Phase) -> Manoeuvre:
        """What is flown when the aircraft answers again."""
        if phase is Phase.LANDING:
            return Land(self._sight, self._cfg.autopilot)
        return Hold(self._sight, self._cfg.autopilot) if phase is Phase.ABORTED else self._make(setpoint)

    def _prepare(self, setpoint: Setpoint, situation: Situation) -> Step:
        """What the flight would begin with, and what it waits for."""
        self.current = self._make(setpoint)
        entered = self.current.enter(None, situation.now)
        obstacle = waits_for(NewManoeuvre.by(setpoint), situation) or entered
        step = self.current.step(situation.now, is_flying=False)
        return replace(step, obstacle=obstacle) if obstacle else step

    def _fly(self, setpoint: Setpoint, before: Phase | None, phase: Phase, situation: Situation) -> Step:
        """Go on, or change to what setpoint and phase ask for."""
        assert self.current is not None
        now = situation.now
        if phase is Phase.LANDING:
            if before is not Phase.LANDING and not isinstance(self.current, Land):
                self._change(Land(self._sight, self._cfg.autopilot), now)
        elif phase is Phase.ABORTED:
            if before is not Phase.ABORTED:
                self._abort(situation)
        elif setpoint.kind != self.current.kind:
            self._change(self._make(setpoint), now)
        else:
            self.current.follow(setpoint)
        return self.current.step(now, is_flying=True)

    def end(self) -> None:
        """Nothing is flown any more."""
        self._sight.stand(is_standing=False)
        self._sight.leave_to_pilot(is_his=False)
        self._sight.answer.forget()
        self._sight.named = ""
        self.current = self._left = None
        self._stage, self.may_touch = "", False

    def _make(self, setpoint: Setpoint) -> Manoeuvre:
        return self._rows[type(setpoint)](self._sight, self._cfg, setpoint)

    def _change(self, after: Manoeuvre, now: float) -> None:
        after.enter(self.current, now)
        self.current = after

    def _abort(self, situation: Situation) -> None:
        """Let the manoeuvre become what an abort makes of it; a hold after a flight by hand is a beginning."""
        assert self.current is not None
        before, after = self.current, self.current.abort(situation.now)
        if after is before:
            return
        hold = NewManoeuvre(Concern.HOLD, target=self._sight.target)
        if isinstance(after, Hold) and refusal(hold, situation) is not None:
            after = Level(self._sight)
        after.enter(before, situation.now)
        self.current = after

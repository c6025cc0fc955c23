"""The manoeuvre that is flown: begun, changed, aborted, and what may take its place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.admission import Concern, NewManoeuvre
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.land import Land
from mkdaemon.control.manoeuvres.level import Level
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step, ended, level_at
from mkdaemon.control.manoeuvres.table import Row
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.control.sight import Sight
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ErrorValue, Outcome, Phase
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import Setpoint

Admit = Callable[[NewManoeuvre, Concern | None, float], CommandRejectedError | None]
"""Says why a manoeuvre may not begin after another one (None on the ground), at a time [s]; see `admission.refusal`."""
WaitsFor = Callable[[NewManoeuvre, float], str]
"""Says what a flight waits for that would begin with a manoeuvre at a time [s]; see `admission.waits_for`."""


class Flown:
    """Holds the one manoeuvre that is flown, or would be.

    Attributes:
        current: it; None before the first setpoint.
        error: how far the aircraft was from its goal at the last step; None without a goal.
        may_touch: what is flown may touch the ground, see `Step.may_touch`.
    """

    def __init__(
        self,
        cfg: ControlConfig,
        sight: Sight,
        rows: Mapping[type[Setpoint], Row],
        admit: Admit,
        waits_for: WaitsFor,
    ) -> None:
        """Fly nothing yet.

        Args:
            cfg: bands and limits.
            sight: the target that is followed.
            rows: every manoeuvre by its kind of setpoint.
            admit: asked at every beginning and every change.
            waits_for: asked before the flight.
        """
        self.current: Manoeuvre | None = None
        self.error: ErrorValue | None = None
        self.may_touch = False
        self._cfg, self._sight, self._rows = cfg, sight, rows
        self._admit, self._waits_for = admit, waits_for
        self._phase: Phase | None = None
        self._left: Manoeuvre | None = None
        self._admitted: NewManoeuvre | None = None

    # -- at the door ----------------------------------------------------------------------------------------------

    def check(self, setpoint: Setpoint, phase: Phase, now: float) -> None:
        """Refuse a setpoint that cannot be followed, or may not be flown now.

        Raises:
            CommandRejectedError: `no_guidance`, or what admission says.
        """
        if type(setpoint) not in self._rows:
            known = ", ".join(sorted(each.suffix for each in self._rows))
            raise refuse(Token.NO_GUIDANCE, name=setpoint.suffix, known=known)
        wanted, before = NewManoeuvre.by(setpoint), self.concern if phase.is_streamed else None
        if before is wanted.concern and wanted == self._admitted:
            return  # who flies on as he was admitted is asked nothing that could have changed
        if phase.is_in_flight and not phase.is_streamed:
            # It is not flown; it only has to be one that could be.
            before = wanted.concern
        refusal = self._admit(wanted, before, now)
        if refusal is not None:
            raise refusal
        self._admitted = wanted

    @property
    def concern(self) -> Concern | None:
        """What is flown, as admission knows it; None before the first setpoint."""
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

    def step(self, setpoint: Setpoint, phase: Phase, now: float) -> Step:
        """Decide the sticks for the newest setpoint in a phase of authority at a time [s]."""
        before, self._phase = self._phase, phase
        if phase not in IN_FLIGHT:
            step = self._prepare(setpoint, now)
        elif phase is Phase.UNANSWERED or self._is_unanswered(now):
            step = self._wait(setpoint, phase, now)
        else:
            self._left = None
            self._sight.leave_to_pilot(is_his=False)
            step = self._fly(setpoint, before, phase, now)
        self.error, self.may_touch = step.error, step.may_touch
        self._sight.stand(is_standing=step.stands)
        is_flown = phase in IN_FLIGHT and (phase is Phase.UNANSWERED or self.is_by_target)
        self._sight.judge_answer(says_something=is_flown and not step.may_touch)
        return step

    def _is_unanswered(self, now: float) -> bool:
        """Whether the aircraft, flown by the target and off the ground, does not answer its sticks."""
        return self.is_by_target and not self.may_touch and bool(self._sight.answer.missing_words(now))

    def _wait(self, setpoint: Setpoint, phase: Phase, now: float) -> Step:
        """Level, and ready to go on where the aircraft is as soon as it answers and is seen.

        Nothing that was learnt from sticks that did not act is kept.
        """
        if self._left is None:
            self._left = self.current
            self._sight.leave_to_pilot(is_his=True)
        after = self._resumed(setpoint, phase)
        wanted = NewManoeuvre.by(setpoint)
        if (after.is_by_target and phase is not Phase.UNANSWERED) or wanted.concern is Concern.TAKE_OFF:
            wanted = NewManoeuvre(Concern.HOLD, target=wanted.target)
        goes_on = after.is_by_target and self._left is not None and self._left.is_by_target
        if goes_on:
            wanted = replace(wanted, is_resumed=True, target=wanted.target or self._sight.target)
        entered = after.enter(self._left if after.is_by_target else None, now)
        obstacle = self._waits_for(wanted, now) or entered
        self.current, step = after, after.step(now, is_flying=False)
        age = self._sight.pose_age(now)
        is_lost = after.is_by_target and (age is None or age > self._cfg.autopilot.exit_after)
        end = ended(Outcome.SIGHT_LOST, target=self._sight.target, age=age or 0.0) if is_lost else None
        sticks = level_at(self._sight.hover_gas)
        shown = replace(step, is_done=False, stands=False, is_unanswered=True, is_level=True)
        return replace(shown, sticks=sticks, obstacle=obstacle, end=end)

    def _resumed(self, setpoint: Setpoint, phase: Phase) -> Manoeuvre:
        """What is flown when the aircraft answers again."""
        if phase is Phase.LANDING:
            return Land(self._sight, self._cfg.autopilot)
        return Hold(self._sight, self._cfg.autopilot) if phase is Phase.ABORTED else self._make(setpoint)

    def _prepare(self, setpoint: Setpoint, now: float) -> Step:
        """What the flight would begin with, and what it waits for."""
        self.current = self._make(setpoint)
        entered = self.current.enter(None, now)
        obstacle = self._waits_for(NewManoeuvre.by(setpoint), now) or entered
        step = self.current.step(now, is_flying=False)
        return replace(step, obstacle=obstacle) if obstacle else step

    def _fly(self, setpoint: Setpoint, before: Phase | None, phase: Phase, now: float) -> Step:
        """Go on, or change to what setpoint and phase ask for."""
        assert self.current is not None
        if phase is Phase.LANDING:
            if before is not Phase.LANDING and not isinstance(self.current, Land):
                self._change(Land(self._sight, self._cfg.autopilot), now)
        elif phase is Phase.ABORTED:
            if before is not Phase.ABORTED:
                self._abort(now)
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
        self.may_touch = False

    def _make(self, setpoint: Setpoint) -> Manoeuvre:
        return self._rows[type(setpoint)].make(self._sight, self._cfg, setpoint)

    def _change(self, after: Manoeuvre, now: float) -> None:
        after.enter(self.current, now)
        self.current = after

    def _abort(self, now: float) -> None:
        """Let the manoeuvre become what an abort makes of it; a hold after a flight by hand is a beginning."""
        assert self.current is not None
        before, after = self.current, self.current.abort(now)
        if after is before:
            return
        hold = NewManoeuvre(Concern.HOLD, target=self._sight.target)
        if isinstance(after, Hold) and self._admit(hold, self.concern, now) is not None:
            after = Level(self._sight)
        after.enter(before, now)
        self.current = after

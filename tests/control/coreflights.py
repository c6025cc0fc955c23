"""Whole flights that the core decides, in virtual time: what a client streams by a plan, and what was published."""

from __future__ import annotations

import math

from lab.control.corerig import CoreRig
from mkdaemon.control.actions import PublishError, PublishStatus, ReleaseAircraft, SendSticks
from mkdaemon.control.events import AbortAsked, MotorsReported
from mkdaemon.telemetry.command import AbortRequest


class Told(CoreRig):
    """A flight, and what its core did in it."""

    def of(self, kind, start=-math.inf, end=math.inf):
        """Actions of a kind between two times [s], each with its time."""
        return [(at, action) for at, action in self.actions if isinstance(action, kind) and start <= at < end]

    def first(self, kind, start=-math.inf, **fields):
        """The first action of a kind with these fields from a time [s] on, with its time."""
        wanted = fields.items()
        return next(
            (at, action)
            for at, action in self.of(kind, start)
            if all(getattr(action, name) == value for name, value in wanted)
        )

    @property
    def status(self):
        """What was published last."""
        return self.of(PublishStatus)[-1][1]

    def counts(self, start=-math.inf, end=math.inf):
        """Sticks that left between two times [s]."""
        return [action.counts for _, action in self.of(SendSticks, start, end)]

    def goals(self, start, end):
        """Where the aircraft was to be between two times [s]."""
        return [action.value.goal for _, action in self.of(PublishError, start, end)]


class UntilReleased(Told):
    """Ends with its release: who flies afterwards would have to be told of the whole flight."""

    def _is_over(self, at):
        super()._is_over(at)
        return any(isinstance(action, ReleaseAircraft) for _, action in self.actions[-9:])


class Plan(Told):
    """Streams what a plan says: times [s], setpoints and their fields; before the first it holds a position.

    Somebody asks for an abort at a time [s]; motors are reported where it is said whether they run.
    """

    def __init__(self, flight, *plan, abort_at=math.inf, motors=None):
        super().__init__(flight)
        self.plan, self.abort_at, self.motors = plan, abort_at, motors

    def _control(self, at):
        if self.motors is not None:
            self.core.feed(MotorsReported(self.motors), at)
        if at >= self.abort_at:
            self.abort_at = math.inf
            self.core.feed(AbortAsked(AbortRequest(reason="the operator saw something")), 0.0)
        super()._control(at)

    def _setpoint(self, goal, at):
        kind, fields = next(((k, f) for start, k, f in reversed(self.plan) if at >= start), (None, {}))
        if kind is None:
            return super()._setpoint(goal, at)
        return kind(epoch=self._epoch, sequence=self._sequence, ttl=0.3, **fields)

"""The missions of configs/missions: read as `mkctl fly` reads them, and flown by the flight core in virtual time."""

from __future__ import annotations

import math

import pytest

from lab.control.corerig import CoreRig
from lab.control.flights import Flight
from lab.places import ROOT
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.actions import PublishStatus, ReleaseAircraft
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.events import MotorsReported
from mkdaemon.control.path.stored import StoredPaths
from mkdaemon.missions.script import (
    GotoStep,
    HoldStep,
    LandStep,
    PathStep,
    TakeOffStep,
    VelocityStep,
    WaitStep,
    read_script,
)
from mkdaemon.telemetry.setpoint import (
    HoldSetpoint,
    LandSetpoint,
    PositionSetpoint,
    SetpointFrame,
    TakeOffSetpoint,
    VelocitySetpoint,
)
from mksim.config import WindClass

SAMPLES = sorted((ROOT / "configs" / "missions").glob("*.toml"))
FLOWN = ROOT / "configs" / "missions" / "hover.toml"
FENCE = AutopilotConfig()


class Mission(CoreRig):
    """Streams the setpoint of a step until it is done or its time is over, as `mkctl fly` does.

    Attributes:
        finished: when each step was [s].
    """

    def __init__(self, flight, steps):
        super().__init__(flight)
        self.steps = [step for step in steps if not isinstance(step, WaitStep)]
        self.motors, self.finished, self._began = flight.start <= 0.0, [], 0.0

    def _control(self, at):
        if self.motors:
            self.core.feed(MotorsReported(True), at)
        super()._control(at)
        if len(self.finished) < len(self.steps) and self._is_done(self.steps[len(self.finished)], at):
            self.finished.append(at)
            self._began = at

    def _is_done(self, step, at):
        if isinstance(step, HoldStep | VelocityStep):
            return at - self._began >= step.seconds
        status = next((a for _, a in reversed(self.actions) if isinstance(a, PublishStatus)), None)
        is_done = status is not None and status.is_done and status.manoeuvre == self._setpoint(None, at).kind
        return is_done and at - self._began > 0.5 and not isinstance(step, LandStep)

    def _setpoint(self, goal, at):
        stream = {"epoch": self._epoch, "sequence": self._sequence, "ttl": 0.3}
        match self.steps[min(len(self.finished), len(self.steps) - 1)]:
            case TakeOffStep(height=height):
                return TakeOffSetpoint(**stream, height=height)
            case HoldStep():
                return HoldSetpoint(**stream)
            case GotoStep() as step:
                yaw = None if step.yaw_deg is None else math.radians(step.yaw_deg)
                return PositionSetpoint(**stream, position=step.position, frame=SetpointFrame(step.frame), yaw=yaw)
            case VelocityStep() as step:
                return VelocitySetpoint(**stream, velocity=step.velocity, frame=SetpointFrame(step.frame))
            case _:
                return LandSetpoint(**stream)

    def _is_over(self, at):
        return bool(self.ended)

    @property
    def ended(self):
        """Why the core let go; empty while it has not."""
        return next((action.reason for _, action in self.actions[-3:] if isinstance(action, ReleaseAircraft)), "")


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.stem)
def test_a_sample_is_read_and_stays_inside_the_fence(path):
    steps = read_script(path)
    assert isinstance(steps[-1], LandStep)
    places = [step.position for step in steps if isinstance(step, GotoStep) and step.frame == "pad"]
    for step in steps:
        if isinstance(step, PathStep):
            stored = StoredPaths(FENCE)
            places += stored.find(stored.upload(step.request, AircraftModel()).id).drawn
    assert places
    assert all(math.hypot(*place[:2]) < FENCE.fence_radius / 2 for place in places)
    assert all(FENCE.fence_floor < place[2] < FENCE.fence_height for place in places)


def test_a_sample_is_flown_to_its_end_on_the_target():
    rig = Mission(Flight(seed=4, wind=WindClass.INDOOR, start=0.0, seconds=60.0), read_script(FLOWN))
    record = rig.fly()
    assert (record.lost, rig.ended) == ("", "landed on pad")
    assert len(rig.finished) == len(rig.steps) - 1
    assert math.hypot(*record.positions[-1][:2]) < 0.15

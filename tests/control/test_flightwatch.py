"""What the boards do with the sticks besides ends a flight by position."""

from __future__ import annotations

import pytest

from mkdaemon.control.events import PoseSeen, StateValue
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.goto import Goto
from mkdaemon.control.manoeuvres.manoeuvre import Step
from mkdaemon.control.manoeuvres.table import Row
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from mkdaemon.telemetry.state import GpsMode
from tests.control.events import PERIOD, Driver, flight, pose


class Anywhere(Goto):
    """A manoeuvre that is always content."""

    def enter(self, before, facts, now):
        return ""

    def step(self, now, *, is_flying):
        return Step(Sticks(0.0, 0.0, 0.0, -2.0), self.kind)


ANYWHERE = {PositionSetpoint: Row(lambda sight, cfg, new: Anywhere(sight, cfg.autopilot, new))}


def by_position(drive, seconds):
    for _ in range(round(seconds / PERIOD)):
        drive.sequence += 1
        drive.core.feed(PoseSeen(pose(drive.now)), drive.now)
        place = {"position": (0.0, 0.0, 2.0), "frame": SetpointFrame.PAD}
        assert drive.offer(PositionSetpoint(epoch=drive.epoch, sequence=drive.sequence, ttl=0.3, **place)) is None
        drive.run(PERIOD)


@pytest.mark.parametrize("mode", list(GpsMode))
def test_a_navictrl_that_steers_too_ends_a_flight_by_position(mode):
    drive = Driver(rows=ANYWHERE)
    drive.core.feed(PoseSeen(pose(drive.now)), drive.now)
    drive.take()
    by_position(drive, 3.0)
    assert drive.core.phase is Phase.FLYING
    drive.core.feed(StateValue(flight(is_flying=True).model_copy(update={"gps_mode": mode})), drive.now)
    if mode.steers:
        drive.run(0.1)
        [release] = drive.releases
        assert release.reason.endswith(f"the pilot's GPS switch is at {mode.value}, so the NaviCtrl steers too")
    else:
        by_position(drive, 0.3)
        assert drive.core.phase is Phase.FLYING

"""What the boards do with the sticks besides ends a flight by position."""

from __future__ import annotations

import pytest
from mkdaemon.control.setpoints import Guided

from mkdaemon.control.events import StateValue
from mkdaemon.control.limiter import Sticks
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from mkdaemon.telemetry.state import GpsMode
from tests.control.events import PERIOD, Driver, flight


class Anywhere:
    """Guidance that is always content."""

    def check(self, setpoint):
        """Refuse nothing."""

    def guide(self, setpoint, facts, now, *, is_flying):
        return Guided(Sticks(0.0, 0.0, 0.0, -2.0))


def by_position(drive, seconds):
    for _ in range(round(seconds / PERIOD)):
        drive.sequence += 1
        place = {"position": (0.0, 0.0, 2.0), "frame": SetpointFrame.PAD}
        assert drive.offer(PositionSetpoint(epoch=drive.epoch, sequence=drive.sequence, ttl=0.3, **place)) is None
        drive.run(PERIOD)


@pytest.mark.parametrize("mode", list(GpsMode))
def test_a_navictrl_that_steers_too_ends_a_flight_by_position(mode):
    drive = Driver(guidance={PositionSetpoint: Anywhere()})
    drive.take()
    by_position(drive, 1.2)
    assert drive.core.phase is Phase.FLYING
    drive.core.feed(StateValue(flight(is_flying=True).model_copy(update={"gps_mode": mode})), drive.now)
    if mode.steers:
        drive.run(0.1)
        [release] = drive.releases
        assert release.reason.endswith(f"the pilot's GPS switch is at {mode.value}, so the NaviCtrl steers too")
    else:
        by_position(drive, 0.3)
        assert drive.core.phase is Phase.FLYING

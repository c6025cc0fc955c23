"""Silence is answered at its deadline and not at the tick after it; in virtual time."""

from __future__ import annotations

from lab.rigs.cockpit import Boards
from lab.stories.deaths import Death, fly_session
from mkdaemon.config.control import ControlConfig

SILENT = (Death.FROZEN, Death.STALE, Death.OLD_EPOCH)
ON_THE_WIRE = 0.005
"""From the decision to the last character of a frame at 57600 baud [s]."""


def test_neutral_sticks_leave_when_the_setpoint_grows_too_old():
    cfg = ControlConfig()
    for loss in fly_session(Boards("2.12a"), seed=7, deaths=3, watched=1.5, ways=SILENT):
        assert loss.wire is not None
        assert cfg.limiter.setpoint_ttl < loss.wire < cfg.limiter.setpoint_ttl + ON_THE_WIRE
        assert loss.released is not None
        # The board's next request for its receiver values comes between.
        assert cfg.lease.release_after < loss.released < cfg.lease.release_after + 4 * ON_THE_WIRE

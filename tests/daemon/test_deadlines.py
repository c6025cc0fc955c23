"""Silence is answered at its deadline and not at the tick after it; in virtual time."""

from __future__ import annotations

from lab.rigs.cockpit import Boards
from lab.stories.deaths import Death, fly_session
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.link import LinkConfig

SILENT = (Death.FROZEN, Death.STALE, Death.OLD_EPOCH)
TAKEN = 1.0 / LinkConfig(port="/dev/x").setpoint_hz + 0.012
"""From the turn of a stick frame whose place a request took until the next one, 12 ms behind the request [s]."""
ON_THE_WIRE = 0.005
"""From the decision to the last character of a frame at 57600 baud [s]."""


def test_neutral_sticks_leave_when_the_setpoint_grows_too_old():
    cfg = ControlConfig()
    for loss in fly_session(Boards("2.12a"), seed=7, deaths=3, watched=1.5, ways=SILENT):
        assert loss.wire is not None
        # A request may have taken the place of the frame that was due: docs/safety.md promises 0.35 s.
        assert cfg.limiter.setpoint_ttl < loss.wire < cfg.limiter.setpoint_ttl + TAKEN + ON_THE_WIRE
        assert loss.released is not None
        # The board's next request for its receiver values comes between.
        assert cfg.lease.release_after < loss.released < cfg.lease.release_after + TAKEN + ON_THE_WIRE

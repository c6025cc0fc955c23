"""Silence is answered at its deadline and not at the tick after it; in virtual time."""

from __future__ import annotations

import pytest

from lab.rigs.cockpit import Boards
from lab.stories.deaths import Death, fly_session
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.authority import Authority
from mkdaemon.telemetry.setpoint import StickSetpoint

SILENT = (Death.FROZEN, Death.STALE, Death.OLD_EPOCH)
ON_THE_WIRE = 0.005
"""From the decision to the last character of a frame at 57600 baud [s]."""


def test_neutral_sticks_leave_when_the_setpoint_grows_too_old():
    cfg = ControlConfig()
    for loss in fly_session(Boards("2.12a"), seed=7, deaths=3, ways=SILENT):
        assert loss.wire is not None
        assert cfg.limiter.setpoint_ttl < loss.wire < cfg.limiter.setpoint_ttl + ON_THE_WIRE
        assert loss.released is not None
        # The board's next request for its receiver values comes between.
        assert cfg.lease.release_after < loss.released < cfg.lease.release_after + 4 * ON_THE_WIRE


def test_the_next_deadline_is_that_of_the_phase():
    cfg = ControlConfig()
    authority = Authority(cfg, first_epoch=1)
    assert authority.deadline() is None
    epoch = authority.take("alice", 0.0).epoch
    assert authority.deadline() is None
    for step in range(1, 201):
        authority.offer(
            StickSetpoint(epoch=epoch, sequence=step, ttl=0.2, pitch=0.0, roll=0.0, yaw=0.0, throttle=0.0), step * 0.02
        )
        authority.tick(step * 0.02)
    last = 200 * 0.02
    assert authority.deadline() == pytest.approx(last + 0.2)
    authority.tick(last + 0.201)
    assert authority.deadline() == pytest.approx(last + cfg.lease.release_after)
    authority.tick(last + cfg.lease.release_after + 0.001)
    assert authority.deadline() is None

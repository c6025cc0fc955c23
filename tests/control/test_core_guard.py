"""The core and the guard: no lease without it, and no flight goes on after it, or after a stall of our own."""

from __future__ import annotations

import pytest

from mkdaemon.control.actions import ReportFailsafe
from mkdaemon.control.events import GuardActed, GuardChanged
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.refusals import Token
from tests.control.events import CFG, Driver


@pytest.fixture
def drive():
    return Driver()


def test_without_a_guard_nobody_gets_a_lease(drive):
    drive.core.feed(GuardChanged(is_alive=False), drive.now)
    with pytest.raises(CommandRejectedError) as refusal:
        drive.take()
    assert refusal.value.token == Token.GUARD_DEAD
    drive.core.feed(GuardChanged(is_alive=True), drive.now)
    drive.take()


def test_a_guard_that_dies_in_flight_ends_no_flight(drive):
    drive.fly()
    drive.core.feed(GuardChanged(is_alive=False), drive.now)
    drive.stream(1.0)
    assert drive.core.phase is Phase.FLYING


def test_a_release_by_the_guard_ends_the_lease_and_is_followed_by_our_own(drive):
    drive.fly()
    drive.core.feed(GuardActed(), drive.now)
    drive.tick()
    assert len(drive.releases) == 1
    assert drive.core.phase is Phase.RELEASING
    drive.release_ends()
    drive.run(0.1)
    assert drive.core.phase is Phase.FREE
    assert drive.put().token == Token.NOT_LEASED
    assert any(report.action == "release" for report in drive.of(ReportFailsafe))


@pytest.mark.parametrize("stall", [0.35, 1.0, 30.0])
def test_after_a_stall_of_our_own_the_release_comes_before_any_stick_frame(drive, stall):
    drive.fly()
    drive.put(pitch=40.0)
    drive.now += stall
    drive.put(pitch=40.0)
    actions = drive.tick()
    assert drive.sticks == []
    assert len(drive.releases) == 1
    assert "did not run" in drive.releases[0].reason
    assert actions


def test_a_stall_shorter_than_a_setpoint_lives_ends_nothing(drive):
    drive.fly()
    drive.now += CFG.limiter.setpoint_ttl - 0.05
    drive.put()
    drive.tick()
    assert drive.core.phase is Phase.FLYING

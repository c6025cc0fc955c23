"""Live sets that are owed: when the next attempt comes, and whose they are."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from mkdaemon.clock import Clock
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.procedures import Interlock, Journal
from mkdaemon.daemon.procedures.recovery import RETRIES, Recovery
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.procedures.live_set import Recovered
from tests.control.admission.situations import GOOD
from tests.control.events import link_state
from tests.daemon.procedures.procedure_rig import Bus
from tests.daemon.procedures.test_journal import NOTE


class Ground:
    """A recovery with an aircraft that stands still before it."""

    def __init__(self, folder):
        self.bus, self.facts = Bus(), VehicleMemory()
        self.facts.link_changed(link_state())
        self.link = SimpleNamespace(
            is_up=True, lacks_flightctrl=False, dialect=SimpleNamespace(fc_release=NOTE.firmware)
        )  # fmt: skip
        self.interlock = Interlock(lambda: GOOD)
        clock = Clock(monotonic=lambda: 0.0)
        self.recovery = Recovery(Journal(folder), self.link, self.facts, Audit(self.bus, clock), self.interlock)

    def next_note(self, now):
        self.facts.motors_reported(False, now)
        return self.recovery.next_note(now)


@pytest.fixture
def ground(tmp_path):
    ground = Ground(tmp_path)
    ground.recovery.add(NOTE)
    return ground


def test_attempts_that_fail_come_ever_more_seldom_and_the_same_reason_is_told_once(ground):
    now = 100.0
    for pause in (*RETRIES, RETRIES[-1], RETRIES[-1]):
        assert ground.next_note(now) is NOTE
        ground.recovery.attempt_failed(NOTE, "the board fell silent", now)
        assert ground.next_note(now + pause - 0.01) is None
        now += pause
    assert [text for text in ground.bus.texts() if "the board fell silent" in text] == [
        "parameter set 3 was live when settings_backup of tester was cut off: the board fell silent"
    ]


def test_without_telemetry_about_the_motors_no_attempt_is_made_and_the_refusal_says_why(ground):
    assert ground.recovery.next_note(100.0) is None
    with (
        pytest.raises(CommandRejectedError, match="or their state is unknown"),
        ground.interlock.taking_lease(),
    ):
        pass
    assert ground.next_note(100.0) is NOTE


def test_an_aircraft_with_other_sets_is_set_aside_until_the_port_is_opened_again(ground):
    ground.next_note(100.0)
    ground.recovery.attempt_ended(NOTE, Recovered.OTHER_AIRCRAFT)
    assert ground.interlock.owed is None
    assert ground.next_note(101.0) is None
    [owed] = ground.recovery.list_notes()
    assert (owed.is_owed, "another aircraft" in owed.detail) == (False, True)
    ground.facts.link_changed(link_state(openings=2))
    assert ground.next_note(102.0) is NOTE


def test_a_verdict_about_an_aircraft_that_has_gone_meanwhile_sets_no_note_aside(ground):
    ground.next_note(100.0)
    ground.link.is_up = False
    ground.next_note(100.1)
    ground.recovery.attempt_ended(NOTE, Recovered.OTHER_AIRCRAFT)
    assert ground.interlock.owed is NOTE

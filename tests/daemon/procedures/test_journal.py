"""Notes of live sets: whole on the disk, whose they are, and when the next attempt comes."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace

import pytest

from mkdaemon.clock import Clock
from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.procedures import Interlock, Journal, state_folder
from mkdaemon.daemon.procedures.journal import Note
from mkdaemon.daemon.procedures.recovery import RETRIES, Recovery
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.procedures.live_set import Recovered
from mkdaemon.stamp import Stamp
from tests.control.admission.situations import GOOD
from tests.control.events import link_state
from tests.daemon.procedures.procedure_rig import Bus

NOTE = Note(
    id="0a",
    verb="settings_backup",
    holder="tester",
    stamp=Stamp(monotonic=1.0, wall=2.0),
    firmware="2.12a",
    active=3,
    live=b"\x6a\x01",
    writing={},
)


class SlowJournal(Journal):
    """Its disk writes when it is allowed to."""

    allowed = threading.Event()

    def write(self, note):
        self.allowed.wait(30)
        super().write(note)


async def test_a_note_whose_writing_was_not_waited_for_is_gone_when_it_was_dropped(tmp_path):
    journal = SlowJournal(tmp_path)
    keeping = asyncio.create_task(journal.keep(NOTE))
    await asyncio.sleep(0)
    keeping.cancel()
    dropping = asyncio.create_task(journal.drop(NOTE.id))
    await asyncio.sleep(0)
    journal.allowed.set()
    await dropping
    assert list(tmp_path.iterdir()) == []


async def test_a_note_is_read_as_it_was_kept_and_dropped_twice(tmp_path):
    journal = Journal(tmp_path / "new")
    assert journal.read() == ([], [])
    await journal.keep(NOTE)
    assert journal.read() == ([NOTE], [])
    await journal.drop(NOTE.id)
    await journal.drop(NOTE.id)
    assert journal.read() == ([], [])


@pytest.mark.parametrize("change", ["keep", "drop"])
async def test_a_folder_that_cannot_be_changed_is_named(tmp_path, change, monkeypatch):
    journal = Journal(tmp_path)
    await journal.keep(NOTE)

    def refuse(*_, **__):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("mkdaemon.daemon.procedures.journal.write_whole", refuse)
    monkeypatch.setattr("pathlib.Path.unlink", refuse)
    with pytest.raises(CommandRejectedError, match=f"journal_unwritable.*{tmp_path}: Read-only file system"):
        await (journal.keep(NOTE) if change == "keep" else journal.drop(NOTE.id))


def test_a_note_of_another_form_and_a_folder_that_cannot_be_read_are_no_notes(tmp_path, monkeypatch):
    path = tmp_path / "live-set-1.json"
    path.write_text(NOTE.model_dump_json().replace('"version":1', '"version":2'))
    (tmp_path / "guard.json").write_text("{}")
    assert Journal(tmp_path).read() == ([], [path])

    def refuse(folder):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.iterdir", refuse)
    assert Journal(tmp_path).read() == ([], [tmp_path])


def test_the_folder_of_what_survives_a_restart(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    vehicle = VehicleConfig(name="mk1")
    assert state_folder(vehicle) == tmp_path / ".local/state/mkdaemon/mk1"
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "own"))
    assert state_folder(vehicle) == tmp_path / "own/mkdaemon/mk1"
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path}/service:/other")
    assert state_folder(vehicle) == tmp_path / "service/mk1"
    assert state_folder(VehicleConfig(state_folder=tmp_path / "given")) == tmp_path / "given"


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

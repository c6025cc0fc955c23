"""Notes of live sets on the disk: in order, whole, and what cannot be read is named."""

from __future__ import annotations

import asyncio
import threading

import pytest

from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.daemon.procedures import Journal, state_folder
from mkdaemon.daemon.procedures.journal import Note
from mkdaemon.errors import CommandRejectedError
from mkdaemon.stamp import Stamp

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

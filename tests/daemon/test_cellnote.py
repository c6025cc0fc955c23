"""How many cells the battery has: configured, remembered, or learnt at rest and remembered for the next start."""

from __future__ import annotations

import asyncio

import pytest

from mkdaemon.control.events import CellsKnown
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.cellnote import LOOK, NAME, CellNotes
from tests.control.test_batterywatch import battery


class Log:
    def __init__(self):
        self.lines = []

    def log(self, level, text):
        self.lines.append((level, text))


async def followed(notes, facts, log=None):
    """What the flight core is told during the first look at the notes, and the next two."""
    fed, looks, sleep = [], 0, asyncio.sleep

    async def counted(seconds):
        nonlocal looks
        assert seconds == LOOK
        looks += 1
        await sleep(0)
        if looks == 3:
            raise asyncio.CancelledError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mkdaemon.daemon.cellnote.asyncio.sleep", counted)
        with pytest.raises(asyncio.CancelledError):
            await notes.follow(facts, fed.append, log or Log())
    return fed


def resting(voltage):
    facts = VehicleMemory()
    facts.motors_reported(False, 1.0)
    facts.state_received(battery(voltage), 1.0)
    return facts


async def test_cells_that_a_battery_shows_at_rest_are_remembered(tmp_path):
    assert await followed(CellNotes(tmp_path / "new", None), resting(14.6)) == [CellsKnown(4)]
    later = CellNotes(tmp_path / "new", None)
    assert later.read() == 4
    assert await followed(later, resting(12.8)) == [CellsKnown(4)]


async def test_configured_cells_count_and_nothing_else_is_remembered(tmp_path):
    notes = CellNotes(tmp_path, 6)
    assert await followed(notes, resting(14.6)) == [CellsKnown(6)]
    assert not (tmp_path / NAME).exists()


async def test_cells_in_doubt_are_not_remembered(tmp_path):
    assert await followed(CellNotes(tmp_path, None), resting(12.8)) == []
    assert not (tmp_path / NAME).exists()


async def test_a_folder_that_takes_nothing_is_reported_once(tmp_path):
    (tmp_path / "file").write_text("")
    log = Log()
    await followed(CellNotes(tmp_path / "file" / "x", None), resting(14.6), log)
    assert [level for level, _ in log.lines] == ["warning"]


@pytest.mark.parametrize("text", ["", "{}", '{"version": 1, "cells": 0}', '{"version": 1, "cells": "4"}', "x" * 300])
def test_a_note_that_is_none_says_nothing(tmp_path, text):
    (tmp_path / NAME).write_text(text)
    assert CellNotes(tmp_path, None).read() is None

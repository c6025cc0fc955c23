"""Settings of the FlightCtrl as parameters of the node."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from mkdaemon.errors import MkError
from mkdaemon.gateways.ros2.boardsettings import BoardSettings
from mkdaemon.protocol.settings import layout_of
from mkdaemon.telemetry.settings import SettingsBackup, SettingsRestoration, StoredSet

REVISION = 106
RAW = bytes([REVISION]) + bytes(number % 200 for number in range(1, layout_of(REVISION).size))


class Board:
    def __init__(self, raw=RAW):
        self.raw, self.asked, self.settings = raw, [], self

    async def backup(self, slots):
        return SettingsBackup(firmware="2.12a", active=3, sets=(StoredSet(slot=3, raw=self.raw),))

    async def write(self, values, *, on_progress, **options):
        self.asked.append((values, options))
        return SettingsRestoration(firmware="2.12a", active=3, before=(), stored=(), written=(3,))


@pytest.fixture
def made(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    declared = {}
    board = Board()
    settings = BoardSettings(board, lambda name, value, about: declared.update({name: (value, about)}))
    return SimpleNamespace(board=board, settings=settings, declared=declared, folder=tmp_path)


def test_every_setting_is_a_parameter(made):
    count = asyncio.run(made.settings.pull())
    assert count == len(made.declared) > 100 and all(name.startswith("settings.") for name in made.declared)
    assert made.declared["settings.gyro_p"][0] in range(256) and len(made.declared["settings.channels"][0]) == 12
    assert all(about for _, about in made.declared.values())


def test_a_write_is_confirmed_and_the_set_is_saved_before(made):
    with pytest.raises(MkError, match="param/pull"):
        asyncio.run(made.settings.write("settings.gyro_p", 81))
    asyncio.run(made.settings.pull())
    for _ in range(2):
        asyncio.run(made.settings.write("settings.gyro_p", 81))
    assert made.board.asked == [({"gyro_p": 81}, {"confirm": True, "slot": 3})] * 2
    (saved,) = made.folder.rglob("before-*.toml")
    assert "gyro_p" in saved.read_text()


def test_a_set_that_nobody_knows_is_said(made):
    made.board.raw = bytes([250, 1])
    with pytest.raises(MkError, match="layout"):
        asyncio.run(made.settings.pull())

"""`mkctl log play` on a terminal and without one: keys, the bar, the verdict."""

from __future__ import annotations

import asyncio
import gc
import json
import os
import pty
import sys
import termios
from contextlib import contextmanager, suppress

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli import promptness
from mkdaemon.cli.mkctl import play as playcommand
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.play import key_pressed, play, showing_player
from mkdaemon.client.player import PlayPace
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayState, PlayStatus
from tests.bus.support import client, free_endpoint
from tests.client.test_play import STICKS, Listener, samples


@pytest.fixture(autouse=True)
def no_favour(monkeypatch):
    """What is right for a program of its own is not for that of the tests."""
    monkeypatch.setattr(playcommand, "favour_threads", lambda: None)


class FakePlayer:
    """What the screen knows of a player."""

    def __init__(self):
        self.pace = PlayPace(1.0, 0.0, 0.0)
        self.is_stopped = False

    def adjust(self, change):
        change(self.pace, 0.0)

    def stop(self):
        self.is_stopped = True

    def status(self):
        state = PlayState.PAUSED if self.pace.is_paused else PlayState.PLAYING
        return PlayStatus(file="a.mcap", state=state, speed=self.pace.speed, place=3.0, length=12.0, sent=7, values=40)


def test_keys_pause_step_and_change_the_speed():
    player = FakePlayer()
    key_pressed(player, " ")
    assert player.pace.is_paused
    key_pressed(player, "n")
    assert player.pace.wait(5.0, 0.0) == 0.0
    key_pressed(player, " ")
    assert not player.pace.is_paused
    for key, speed in (("+", 2.0), ("=", 4.0), ("-", 2.0), ("x", 2.0)):
        key_pressed(player, key)
        assert player.pace.speed == speed
    assert not player.is_stopped
    key_pressed(player, "q")
    assert player.is_stopped


class Terminal:
    """A pseudo terminal in place of this program's own."""

    def __init__(self):
        self.master, self.slave = pty.openpty()
        os.set_blocking(self.master, False)
        self.shown = ""

    def shows(self, text):
        with suppress(BlockingIOError):
            self.shown += os.read(self.master, 65536).decode()
        return text in self.shown


@contextmanager
def terminal(monkeypatch):
    fake = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.delenv("NO_COLOR", raising=False)
    with os.fdopen(os.dup(fake.slave)) as keys, os.fdopen(os.dup(fake.slave), "w") as screen:
        monkeypatch.setattr(sys, "stdin", keys)
        monkeypatch.setattr(sys, "stderr", screen)
        yield fake
        monkeypatch.undo()
    os.close(fake.slave)
    os.close(fake.master)


async def test_a_terminal_shows_where_it_is_and_takes_keys(monkeypatch):
    player = FakePlayer()
    with terminal(monkeypatch) as fake:
        before = termios.tcgetattr(fake.slave)
        async with showing_player(player, quiet=False):
            await wait_until(lambda: fake.shows("3.0 of 12.0 s, 1 times, 7 values"))
            assert fake.shows("space pause")
            os.write(fake.master, b"+ ")
            await wait_until(lambda: fake.shows("2 times, 7 values, paused"))
            assert player.pace.is_paused
            os.write(fake.master, b"q")
            await wait_until(lambda: player.is_stopped)
        assert termios.tcgetattr(fake.slave) == before


async def test_without_a_terminal_and_for_programs_nothing_is_drawn_and_no_key_taken(monkeypatch, capsys):
    async with showing_player(FakePlayer(), quiet=False):
        await asyncio.sleep(0)
    with terminal(monkeypatch) as fake:
        before = termios.tcgetattr(fake.slave)
        async with showing_player(FakePlayer(), quiet=True):
            assert termios.tcgetattr(fake.slave) == before
            await asyncio.sleep(0)
        assert not fake.shows("space")
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, lambda one: True),
        ({"key": ("state/*",)}, lambda one: one.suffix.startswith("state/")),
        ({"start": "1", "end": "-0.5"}, None),
    ],
)
async def test_what_was_asked_for_is_put_and_counted(capsys, options, expected):
    endpoint = free_endpoint()
    where = Connection(json=True)
    playing = asyncio.create_task(play(STICKS, speed=1000.0, listen=endpoint, connection=where, **options))
    with await asyncio.to_thread(lambda: client(endpoint)) as session:
        listener = Listener(session, "replay/t/**")
        async with asyncio.timeout(15):
            assert await playing == 0
    said = json.loads(capsys.readouterr().out)
    recorded = list(samples())
    if expected is not None:
        assert said["sent"] == sum(map(expected, recorded))
    assert 0 < said["sent"] <= len(recorded)
    assert (said["missing"], said["rounds"]) == ({}, 1)
    assert said["late_p99_s"] >= 0.0
    assert len(listener.heard) <= said["sent"]


async def test_who_ends_it_by_a_key_is_told_what_is_missing(monkeypatch, capsys):
    with terminal(monkeypatch) as fake:
        playing = asyncio.create_task(play(STICKS, speed=0.02, listen=free_endpoint(), wait=0.0))
        await wait_until(lambda: fake.shows("times"))
        os.write(fake.master, b"q")
        assert await playing == 1
    assert "of the file were not put" in capsys.readouterr().out


async def test_keys_work_while_it_waits_and_none_reach_the_shell(monkeypatch, capsys):
    with terminal(monkeypatch) as fake:
        playing = asyncio.create_task(play(STICKS, listen=free_endpoint(), wait=60.0))
        await wait_until(lambda: fake.shows("waiting"))
        before = termios.tcgetattr(fake.slave)[3]
        assert not before & termios.ICANON, "keys come without Return"
        os.write(fake.master, b" ")
        await wait_until(lambda: fake.shows("paused"))
        os.write(fake.master, b"qrm -rf\n")
        assert await playing == 1
        assert termios.tcgetattr(fake.slave)[3] & termios.ICANON
        os.set_blocking(fake.slave, False)
        with pytest.raises(BlockingIOError):
            os.read(fake.slave, 64)
    assert "of the file were not put" in capsys.readouterr().out


async def test_a_recording_that_no_client_wants_is_not_played():
    with pytest.raises(MkError, match="no client subscribed within"):
        await play(STICKS, listen=free_endpoint(), wait=0.05)


def test_a_program_of_its_own_lets_threads_take_turns_often():
    before = sys.getswitchinterval()
    try:
        promptness.favour_threads()
        assert sys.getswitchinterval() == pytest.approx(promptness.SWITCH)
        assert gc.get_freeze_count() > 0
    finally:
        sys.setswitchinterval(before)
        gc.unfreeze()

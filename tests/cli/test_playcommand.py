"""`mkctl log play` on a terminal and without one: keys, the bar, the verdict; and the page of `mkctl view`."""

from __future__ import annotations

import asyncio
import gc
import json
import os
import signal
import sys
import termios

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli import promptness
from mkdaemon.cli.mkctl import play as playcommand
from mkdaemon.cli.mkctl import view as viewcommand
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.play import key_pressed, play, showing_player
from mkdaemon.cli.mkctl.view import view
from mkdaemon.client.player import PlayPace
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayState, PlayStatus
from tests.bus.support import client, free_endpoint
from tests.cli.pseudoterminal import own_terminal
from tests.client.test_play import STICKS, Listener, samples
from tests.view.page.test_server import ask


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


async def test_a_terminal_shows_where_it_is_and_takes_keys(monkeypatch):
    player = FakePlayer()
    with own_terminal(monkeypatch, "stderr") as fake:
        before = termios.tcgetattr(fake.near)
        async with showing_player(player, quiet=False):
            await wait_until(lambda: fake.shows(b"3.0 of 12.0 s, 1 times, 7 values"))
            assert fake.shows(b"space pause")
            fake.type(b"+ ")
            await wait_until(lambda: fake.shows(b"2 times, 7 values, paused"))
            assert player.pace.is_paused
            fake.type(b"q")
            await wait_until(lambda: player.is_stopped)
        assert termios.tcgetattr(fake.near) == before


async def test_without_a_terminal_and_for_programs_nothing_is_drawn_and_no_key_taken(monkeypatch, capsys):
    async with showing_player(FakePlayer(), quiet=False):
        await asyncio.sleep(0)
    with own_terminal(monkeypatch, "stderr") as fake:
        before = termios.tcgetattr(fake.near)
        async with showing_player(FakePlayer(), quiet=True):
            assert termios.tcgetattr(fake.near) == before
            await asyncio.sleep(0)
        assert not fake.shows(b"space")
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
    with own_terminal(monkeypatch, "stderr") as fake:
        playing = asyncio.create_task(play(STICKS, speed=0.02, listen=free_endpoint(), wait=0.0))
        await wait_until(lambda: fake.shows(b"times"))
        fake.type(b"q")
        assert await playing == 1
    assert "of the file were not put" in capsys.readouterr().out


async def test_keys_work_while_it_waits_and_none_reach_the_shell(monkeypatch, capsys):
    with own_terminal(monkeypatch, "stderr") as fake:
        playing = asyncio.create_task(play(STICKS, listen=free_endpoint(), wait=60.0))
        await wait_until(lambda: fake.shows(b"waiting"))
        before = termios.tcgetattr(fake.near)[3]
        assert not before & termios.ICANON, "keys come without Return"
        fake.type(b" ")
        await wait_until(lambda: fake.shows(b"paused"))
        fake.type(b"qrm -rf\n")
        assert await playing == 1
        assert termios.tcgetattr(fake.near)[3] & termios.ICANON
        os.set_blocking(fake.near, False)
        with pytest.raises(BlockingIOError):
            os.read(fake.near, 64)
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


@pytest.fixture(autouse=True)
def no_favour_for_view(monkeypatch):
    """What is right for a program of its own is not for that of the tests."""
    monkeypatch.setattr(viewcommand, "favour_threads", lambda: None)


async def test_a_recording_is_served_until_it_is_asked_to_end(capsys):
    looking = asyncio.create_task(view(STICKS, port=0, no_browser=True, paused=True, connection=Connection(json=True)))
    said = ""

    def is_open() -> bool:
        nonlocal said
        said += capsys.readouterr().out
        return "\n" in said or looking.done()

    await wait_until(is_open)
    address = json.loads(said)["address"]
    port = int(address.rsplit(":", 1)[1].strip("/"))
    head, _ = await ask(port, "/")
    assert head.startswith("HTTP/1.1 200 ")
    os.kill(os.getpid(), signal.SIGTERM)
    await looking

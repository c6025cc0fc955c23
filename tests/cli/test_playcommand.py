"""`mkctl log play` on a terminal: keys and the verdict; and the page of `mkctl view`."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import termios

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli.mkctl import play as playcommand
from mkdaemon.cli.mkctl import view as viewcommand
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.play import key_pressed, play
from mkdaemon.cli.mkctl.view import view
from mkdaemon.client.player import PlayPace
from mkdaemon.telemetry.play import PlayState, PlayStatus
from tests.bus.support import free_endpoint
from tests.cli.pseudoterminal import own_terminal
from tests.client.test_play import STICKS
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

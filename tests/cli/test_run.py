"""`mkdaemon run`: which name the vehicle has, and that a second signal ends it, whatever hangs."""

from __future__ import annotations

import asyncio
import itertools
import os
import signal
import subprocess
import sys
import tty
from pathlib import Path

import pytest

from mkdaemon.cli.mkdaemon.run import vehicle_name
from mkdaemon.daemon.guard import LAST_FRAMES, LastWord
from mkdaemon.guard import RESYNC

NEUTRAL, OLD, NEW = b"#neutral\r", b"#old\r", b"#new\r"
PATIENCE = 60.0  # of a process that imports the daemon, on a busy machine


@pytest.mark.parametrize(
    ("config", "given", "name"),
    [(None, None, "other"), (None, "mk2", "mk2"), (Path("mk1.toml"), None, None), (Path("mk1.toml"), "mk2", "mk2")],
)
def test_the_environment_does_not_rename_the_aircraft_of_a_file(config, given, name, monkeypatch):
    monkeypatch.setenv("MK_VEHICLE", "other")
    assert vehicle_name(config, given) == name


@pytest.fixture
def line():
    """Both ends of a pseudo terminal, raw."""
    far, near = os.openpty()
    tty.setraw(near)
    os.set_blocking(far, False)
    os.set_blocking(near, False)
    yield far, near
    for end in (far, near):
        os.close(end)


def arrived(far):
    """What came out of the line so far."""
    got = b""
    try:
        while chunk := os.read(far, 4096):
            got += chunk
    except BlockingIOError:
        return got
    return got


HANGING = """
import asyncio, sys, time
from mkdaemon.cli.mkdaemon import run as program
from mkdaemon.config.root import Config
from mkdaemon.daemon.guard import GuardProcess
near, kind, is_guarded = int(sys.argv[1]), sys.argv[2], sys.argv[3] == "guarded"
async def fly(cfg, stop, last_word):
    if is_guarded:
        last_word.guard = GuardProcess()
        last_word.guard.start()
        await last_word.guard.wait_for_start()
    last_word.port_opened(near)
    last_word.frames_changed([b"#old\\r", b"#new\\r"])
    last_word.frame_written(b"#neutral\\r")
    print("flies", flush=True)
    while kind == "thinks for ever":
        pass
    if kind == "sleeps in the loop":
        time.sleep(1000.0)
    await stop.wait()
    print("was told to end", flush=True)
    while True:
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            pass
program.run_daemon = fly
with asyncio.Runner(loop_factory=program.fast_loop()) as runner:
    runner.run(program._until_signalled(Config()))
"""


@pytest.mark.parametrize(
    ("number", "guarded", "kind"),
    [
        (signal.SIGINT, "guarded", "ignores its end"),
        (signal.SIGINT, "alone", "thinks for ever"),
        (signal.SIGTERM, "guarded", "thinks for ever"),
        (signal.SIGTERM, "alone", "sleeps in the loop"),
    ],
)
async def test_a_second_signal_releases_and_ends_whatever_hangs(line, kind, guarded, number):
    far, near = line
    daemon = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", HANGING, str(near), kind, guarded), pass_fds=[near], stdout=subprocess.PIPE
    )
    async with asyncio.timeout(PATIENCE):
        assert await daemon.stdout.readline() == b"flies\n"
        daemon.send_signal(number)
        if kind == "ignores its end":
            assert await daemon.stdout.readline() == b"was told to end\n"
        while daemon.returncode is None:
            daemon.send_signal(number)  # one that comes with another before it is one signal
            await asyncio.sleep(0.2)
        assert daemon.returncode == -number
        got = arrived(far)
        while NEW not in got:
            await asyncio.sleep(0.01)
            got += arrived(far)
    assert got.startswith(RESYNC + NEUTRAL)
    assert got.index(NEUTRAL) < got.index(OLD)


def test_the_last_word_is_said_where_something_is_owed_and_only_there(line):
    far, near = line
    word = LastWord()
    word.speak()
    word.port_opened(near)
    word.frames_changed([OLD, NEW])
    word.speak()
    word.frame_written(NEUTRAL)
    word.released()
    word.speak()
    assert arrived(far) == b""
    word.frame_written(NEUTRAL)
    word.speak()
    assert arrived(far) == RESYNC + NEUTRAL + b"".join(itertools.islice(itertools.cycle([OLD, NEW]), LAST_FRAMES))
    word.port_closed()
    word.speak()
    assert arrived(far) == b""
    assert not word.is_guarded

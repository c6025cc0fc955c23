"""`mkdaemon run`: which name the vehicle has, and that a second signal ends it, whatever hangs."""

from __future__ import annotations

import itertools
import os
import select
import signal
import subprocess
import sys
import tty

import pytest

from lab.rigs.waiting import wait_blocking
from mkdaemon.cli.mkdaemon.runoptions import RunOptions, load_configuration
from mkdaemon.daemon.guard import LAST_FRAMES, LastWord
from mkdaemon.guard import RESYNC

NEUTRAL, OLD, NEW = b"#neutral\r", b"#old\r", b"#new\r"


@pytest.mark.parametrize(
    ("config", "given", "name"),
    [(None, None, "other"), (None, "mk2", "mk2"), ("mk1.toml", None, "mk1"), ("mk1.toml", "mk2", "mk2")],
)
def test_the_environment_does_not_rename_the_aircraft_of_a_file(config, given, name, tmp_path):
    path = None if config is None else tmp_path / config
    if path is not None:
        path.write_text("", encoding="utf-8")
    layered = load_configuration(path, RunOptions(vehicle=given), {"MK_VEHICLE": "other"})
    assert layered.cfg.vehicle.name == name


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
    got = bytearray()
    try:
        while chunk := os.read(far, 4096):
            got += chunk
    except BlockingIOError:
        return got
    return got


HANGING = """
import asyncio, os, sys, time
from mkdaemon.cli.mkdaemon import run as program
from mkdaemon.config.root import Config
from mkdaemon.config.reader import load
from mkdaemon.config.root import Config
from mkdaemon.daemon.guard import GuardProcess

def hang(near, guarded, kind):
    async def fly(cfg, stop, last_word, reloading):
        if guarded == "guarded":
            last_word.guard = GuardProcess()
            last_word.guard.start()
            await last_word.guard.wait_for_start()
        last_word.port_opened(near)
        last_word.frames_changed([b"#old\\r", b"#new\\r"])
        last_word.frame_written(b"#neutral\\r")
        print("flies", os.getpid(), flush=True)
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
        runner.run(program._until_signalled(Config(), Config))

for line in sys.stdin:
    path, guarded, kind = line.strip().split(" ", 2)
    near = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    process = os.fork()
    if process == 0:
        hang(near, guarded, kind)
    os.close(near)
    print("ended", os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def hanging():
    """A process that has imported the daemon, and forks one that hangs for every line that it reads."""
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        [sys.executable, "-c", HANGING], stdin=pipe, stdout=pipe, text=True, bufsize=1, start_new_session=True
    )
    with process:
        try:
            yield process
        finally:
            os.killpg(process.pid, signal.SIGKILL)


@pytest.mark.parametrize(
    ("number", "guarded", "kind"),
    [
        (signal.SIGINT, "guarded", "ignores its end"),
        (signal.SIGTERM, "guarded", "thinks for ever"),
        (signal.SIGTERM, "alone", "sleeps in the loop"),
    ],
)
def test_a_second_signal_releases_and_ends_whatever_hangs(line, hanging, kind, guarded, number):
    far, near = line
    hanging.stdin.write(f"{os.ttyname(near)} {guarded} {kind}\n")
    word, process = hanging.stdout.readline().split()
    assert word == "flies"
    os.kill(int(process), number)
    if kind == "ignores its end":
        assert hanging.stdout.readline() == "was told to end\n"
    while not select.select([hanging.stdout], [], [], 0.2)[0]:
        os.kill(int(process), number)  # one that comes with another before it is one signal
    assert hanging.stdout.readline() == f"ended {-number}\n"
    got = arrived(far)
    wait_blocking(lambda: NEW in got or got.extend(arrived(far)))
    assert got.startswith(RESYNC + NEUTRAL)
    assert got.index(NEUTRAL) < got.index(OLD)


def test_a_third_signal_does_not_cut_the_release_short(line, hanging):
    far, near = line
    hanging.stdin.write(f"{os.ttyname(near)} alone thinks for ever\n")
    process = int(hanging.stdout.readline().split()[1])
    os.kill(process, signal.SIGINT)
    while not select.select([far], [], [], 0.2)[0]:
        os.kill(process, signal.SIGINT)
    os.kill(process, signal.SIGINT)
    os.kill(process, signal.SIGTERM)
    assert hanging.stdout.readline() == f"ended {-signal.SIGINT}\n"
    got = arrived(far)
    assert got.count(OLD) + got.count(NEW) == LAST_FRAMES


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

"""The guard as a process: it acts on a real port when the daemon stops, hangs or dies, and only then."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import textwrap
import tty

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.daemon import guard as guardprocess
from mkdaemon.daemon.guard import GuardProcess, take_report
from mkdaemon.guard import IGNORED, RESYNC

NEUTRAL, RELEASE = b"#neutral\r", b"#release\r"
PATIENCE = 60.0  # of a process that imports the daemon, on a busy machine


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


async def arrived(far, wanted):
    """What comes out of the line until `wanted` did."""
    got = b""
    async with asyncio.timeout(PATIENCE):
        while wanted not in got:
            try:
                got += os.read(far, 4096)
            except BlockingIOError:
                await asyncio.sleep(0.005)
    return got


async def flying(near, report=None):
    guard = GuardProcess(report)
    guard.start()
    await guard.wait_for_start()
    guard.port_opened(near)
    guard.frames_changed([RELEASE])
    guard.frame_written(NEUTRAL)
    return guard


async def test_a_guard_without_beats_sends_neutral_then_the_release_and_says_so(line):
    far, near = line
    acts = []
    guard = await flying(near)
    guard.acted = acts.append
    got = await arrived(far, RELEASE)
    assert got.startswith(RESYNC + NEUTRAL)
    await wait_until(lambda: True in acts)
    assert acts[0] is False
    guard.released()
    await guard.stop()


async def test_a_reader_that_comes_late_gets_everything_neutral_first(line):
    """A release once emptied the port first: a pseudo terminal threw away the neutral frame on its way to its reader.

    On a busy machine a frame is on its way for long; here it stands behind more than the reader's end can hold.
    """
    far, near = line
    for _ in range(5):
        os.write(near, bytes(1024))
    guard, acts = await flying(near), []
    guard.acted = acts.append
    await wait_until(lambda: True in acts)
    got = await arrived(far, RELEASE)
    assert got.lstrip(b"\0").startswith(RESYNC + NEUTRAL)
    guard.released()
    await guard.stop()


async def test_no_signal_that_can_be_ignored_ends_the_guard(line):
    far, near = line
    guard = await flying(near)
    for number in IGNORED:
        os.kill(guard.pid, number)
    assert RELEASE in await arrived(far, RELEASE)
    guard.released()
    await guard.stop()


async def test_a_daemon_that_ends_without_a_release_is_followed_by_one(line):
    far, near = line
    guard = await flying(near)
    await guard.stop()
    got = await arrived(far, RELEASE)
    assert got.startswith(RESYNC + NEUTRAL)
    await asyncio.to_thread(guard._process.wait, PATIENCE)


async def test_a_guard_whose_port_is_gone_goes_on_and_uses_the_next_one(line):
    far, near = line
    guard, acts = await flying(near), []
    guard.acted = acts.append
    guard.port_closed()
    await wait_until(lambda: True in acts)
    assert guard.is_alive
    guard.port_opened(near)
    assert RELEASE in await arrived(far, RELEASE)
    guard.released()
    await guard.stop()


async def test_an_orderly_end_sends_nothing(line):
    far, near = line
    guard = await flying(near)
    guard.released()
    await guard.stop()
    assert guard._process.returncode == 0
    with pytest.raises(BlockingIOError):
        os.read(far, 1)


async def test_a_killed_guard_is_reported_at_once(line, monkeypatch):
    monkeypatch.setattr(guardprocess, "PING_PERIOD", 60.0)
    guard, reports = await flying(line[1]), []
    guard.changed = reports.append
    watcher = asyncio.create_task(guard.watch())
    await wait_until(lambda: reports == [True])
    os.kill(guard.pid, signal.SIGKILL)
    await wait_until(lambda: reports == [True, False], within=10.0)
    watcher.cancel()
    await guard.stop()


async def test_a_frozen_guard_is_noticed(line):
    guard = await flying(line[1])
    guard.released()
    os.kill(guard.pid, signal.SIGSTOP)
    watcher = asyncio.create_task(guard.watch())
    await wait_until(lambda: not guard.is_alive)
    watcher.cancel()
    os.kill(guard.pid, signal.SIGKILL)
    await guard.stop()


DAEMON = """
import asyncio, os, signal, sys
from pathlib import Path
from mkdaemon.daemon.guard import GuardProcess
async def main():
    guard = GuardProcess(Path(sys.argv[2]))
    guard.start()
    await guard.wait_for_start()
    guard.port_opened(int(sys.argv[1]))
    guard.frames_changed([b"#release\\r"])
    for _ in range(10):
        guard.frame_written(b"#neutral\\r")
        await asyncio.sleep(0.02)
    print(guard.pid, flush=True)
    os.kill(os.getpid(), getattr(signal, sys.argv[3]))
asyncio.run(main())
"""


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP"])
async def test_a_daemon_that_dies_or_freezes_is_followed_by_a_release_and_a_report(line, tmp_path, name):
    far, near = line
    report = tmp_path / "guard.json"
    script = textwrap.dedent(DAEMON)
    daemon = subprocess.Popen(  # noqa: ASYNC220 - its end is not awaited
        [sys.executable, "-c", script, str(near), str(report), name],
        pass_fds=[near],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        got = await arrived(far, RELEASE)
        assert got.startswith(RESYNC + NEUTRAL)
        if name == "SIGSTOP":
            daemon.kill()
        await wait_until(report.exists)
        assert "release frames sent" in take_report(report)
        assert take_report(report) is None
    finally:
        daemon.kill()
        daemon.wait()
        daemon.stdout.close()

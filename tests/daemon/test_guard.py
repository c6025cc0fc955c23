"""The daemon's side of the guard: what it does when the guard cannot take a packet, or has gone."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket

import pytest

from mkdaemon.daemon import guard as guard_module
from mkdaemon.daemon.guard import SILENCE_LIMIT, GuardProcess, take_report
from mkdaemon.guard import Word


class Started(GuardProcess):
    """Its process is the test: `far` is the other end of the channel.

    Attributes:
        far: the guard's end.
        time: the clock.
    """

    def __init__(self):
        self.time = 0.0
        super().__init__(clock=lambda: self.time)

    def start(self):
        super().start()
        self._process.wait()


@pytest.fixture
async def starting(monkeypatch):
    """A guard whose process is replaced by the far end of its channel, and has said nothing yet."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    far.setblocking(False)
    monkeypatch.setattr(guard_module.sys, "executable", shutil.which("true"))
    monkeypatch.setattr(guard_module.socket, "socketpair", lambda *kind: (near, socket.socket(socket.AF_UNIX)))
    started = Started()
    started.far, started.acts, started.changes = far, [], []
    started.acted, started.changed = started.acts.append, started.changes.append
    started.start()
    yield started
    await started.stop()
    far.close()


@pytest.fixture
async def started(starting):
    """The same, when it has answered for the first time."""
    starting.far.send(Word.PONG)
    await starting.wait_for_start()
    assert starting.far.recv(64) == Word.PING
    return starting


async def turns(count=5):
    for _ in range(count):
        await asyncio.sleep(0)


async def test_a_guard_that_answers_is_alive_and_one_that_is_silent_is_dead(started):
    started.far.send(Word.PONG)
    await turns()
    started.time = SILENCE_LIMIT
    assert started.is_alive
    started.time += 0.001
    assert not started.is_alive
    started.far.send(Word.PONG)
    await turns()
    assert started.is_alive


async def test_a_guard_that_has_not_answered_yet_is_not_alive(starting, monkeypatch):
    monkeypatch.setattr(guard_module, "START_LIMIT", 0.01)
    await starting.wait_for_start()
    assert not starting.is_alive
    starting.far.send(Word.PONG)
    await turns()
    assert starting.is_alive


async def test_a_guard_that_cannot_start_is_not_waited_for(starting):
    starting.far.close()
    async with asyncio.timeout(1.0):
        await starting.wait_for_start()
    assert not starting.is_alive


async def test_it_starts_before_ordinary_programs(monkeypatch):
    favoured = []
    monkeypatch.setattr(guard_module.guard, "go_first", favoured.append)
    process = GuardProcess()
    process.start()
    await process.wait_for_start()
    assert (favoured, process.is_alive) == ([process.pid], True)
    await process.stop()


async def test_every_change_is_told_once(started, monkeypatch):
    monkeypatch.setattr(guard_module, "PING_PERIOD", 0.0)
    watching = asyncio.create_task(started.watch())
    await turns()
    started.time = SILENCE_LIMIT + 1.0
    await turns()
    watching.cancel()
    assert started.changes == [True, False]


async def test_what_it_sends_again_and_again_is_told_once_until_the_daemon_writes(started):
    for word in (Word.NEUTRAL, Word.NEUTRAL, Word.PONG, Word.RELEASED, Word.RELEASED, Word.RELEASED):
        started.far.send(word)
    await turns(10)
    assert started.acts == [False, True]
    started.frame_written(b"level")
    started.far.send(Word.RELEASED)
    await turns()
    assert started.acts == [False, True, True]


async def test_a_guard_that_takes_no_packet_holds_up_nothing(started):
    for _ in range(10_000):
        started.frame_written(bytes(64))
    assert started.is_alive, "only its silence tells"


@pytest.mark.parametrize("is_noticed_by", ["reading", "writing"])
async def test_a_guard_that_has_gone_is_dead_at_once_and_nothing_fails_afterwards(started, is_noticed_by):
    started.far.close()
    if is_noticed_by == "writing":
        started.released()
    else:
        await turns()
    assert not started.is_alive
    started.frame_written(b"#neutral\r")
    started.port_opened(0)


async def test_a_channel_that_fails_is_a_guard_that_has_gone(started, monkeypatch):
    class Failing:
        def fileno(self):
            return started.far.fileno()

        def recv(self, size):
            raise ConnectionResetError

        def close(self):
            self.is_closed = True

    real, started._channel = started._channel, Failing()
    broken = started._channel
    started._receive_answer()
    assert (started.is_alive, broken.is_closed) == (False, True)
    asyncio.get_running_loop().remove_reader(real.fileno())
    real.close()


async def test_a_wake_up_without_a_packet_means_nothing(started):
    started._receive_answer()
    assert started.is_alive


async def test_stopping_what_was_never_started_does_nothing():
    guard = GuardProcess()
    assert (guard.pid, guard.is_alive) == (None, False)
    await guard.stop()
    guard._receive_answer()


def test_a_report_is_taken_once_and_told_even_where_it_cannot_be_removed(tmp_path, monkeypatch):
    path = tmp_path / "guard.json"
    assert take_report(path) is None
    path.write_text(json.dumps({"wall": 1.0, "text": "released"}))
    assert (take_report(path), take_report(path)) == ("released", None)

    def refuse(*_):
        raise PermissionError

    path.write_text(json.dumps({"wall": 1.0, "text": "released"}))
    for function in ("pathlib.Path.unlink", "os.unlink"):
        monkeypatch.setattr(function, refuse)
    assert take_report(path) == "released"


@pytest.mark.parametrize("content", ["", "[]", "{}", "7", "\ud800"])
def test_what_is_no_report_is_none(tmp_path, content):
    path = tmp_path / "guard.json"
    path.write_bytes(content.encode("utf-8", "surrogatepass"))
    assert take_report(path) is None

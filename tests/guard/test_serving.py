"""The guard's loop between its channel and its port, in this process; as one of its own in test_process.py."""

from __future__ import annotations

import array
import json
import os
import select
import signal
import socket
import sys
import time

import pytest

from mkdaemon import guard as program
from mkdaemon.guard import IGNORED, RELEASE_FRAMES, RESYNC, Word, beat

NEUTRAL, RELEASE = b"#neutral\r", b"#release\r"
FRAMES = Word.FRAMES + json.dumps([RELEASE.hex()]).encode()


class Daemon:
    """The other end of the channel, and the far end of the port; everything is said before the guard looks."""

    def __init__(self) -> None:
        self.alarms: list[tuple[int, object]] = []
        self.near, self.channel = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.port, self.board = socket.socketpair()
        for end in (self.near, self.channel, self.port, self.board):
            end.setblocking(False)

    def open_port(self) -> None:
        descriptors = array.array("i", [self.port.fileno()])
        self.near.sendmsg([Word.PORT], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, descriptors.tobytes())])

    def say(self, *packets: bytes) -> None:
        for packet in packets:
            self.near.send(packet)

    def end(self) -> None:
        """Say nothing more; what the guard answers can still be read."""
        self.near.shutdown(socket.SHUT_WR)

    def heard(self) -> list[bytes]:
        """What the guard answered."""
        answers = []
        try:
            while answer := self.near.recv(64):
                answers.append(answer)
        except BlockingIOError:
            return answers
        return answers

    def written(self) -> bytes:
        """What reached the board."""
        try:
            return self.board.recv(4096)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        for end in (self.near, self.channel, self.port, self.board):
            end.close()


@pytest.fixture
def daemon(monkeypatch):
    before = signal.signal(signal.SIGALRM, signal.SIG_IGN)
    both = Daemon()
    monkeypatch.setattr(
        program.signal, "alarm", lambda seconds: both.alarms.append((seconds, signal.getsignal(signal.SIGALRM)))
    )
    yield both
    both.close()
    signal.signal(signal.SIGALRM, before)


def test_a_daemon_that_is_gone_is_followed_by_neutral_and_the_whole_release_and_a_report(daemon, tmp_path, capfd):
    report = tmp_path / "guard.json"
    daemon.open_port()
    daemon.say(FRAMES, beat(NEUTRAL, time.monotonic()))
    daemon.end()
    began = time.time()
    program.serve(daemon.channel, report)
    assert daemon.written() == RESYNC + NEUTRAL + RELEASE * RELEASE_FRAMES
    assert daemon.heard() == [Word.NEUTRAL] + [Word.RELEASED] * RELEASE_FRAMES
    told = json.loads(report.read_text())
    assert told["text"] == f"1 neutral and {RELEASE_FRAMES} release frames sent"
    assert began <= told["wall"] <= time.time()
    assert list(tmp_path.iterdir()) == [report]
    line = f"mkdaemon guard: the daemon stopped while the aircraft was under control; {told['text']}\n"
    assert capfd.readouterr().err == line
    assert daemon.alarms == [(1, signal.SIG_DFL)], "a standard error that takes nothing ends the guard"


def test_what_waits_in_the_port_is_discarded_once_when_the_release_begins(daemon, monkeypatch):
    lines = []

    class Watched(program.PortLine):
        def __init__(self):
            super().__init__()
            self.done = []
            lines.append(self)

        def discard_waiting(self):
            self.done.append("discarded")

        def write(self, frames):
            self.done.append(frames[-1])
            return True

    monkeypatch.setattr(program, "PortLine", Watched)
    daemon.open_port()
    daemon.say(FRAMES, beat(NEUTRAL, time.monotonic()))
    daemon.end()
    program.serve(daemon.channel, None)
    [line] = lines
    assert line.done == [NEUTRAL, "discarded"] + [RELEASE] * RELEASE_FRAMES
    assert line.descriptor == -1


def test_one_packet_is_taken_at_a_time_and_none_where_there_is_none(daemon):
    guard, line, poll = program.Guard(), program.PortLine(), select.poll()
    poll.register(daemon.channel, select.POLLIN)
    assert program._listen(daemon.channel, guard, line, poll) is False
    daemon.say(Word.PORT, Word.PING)
    assert program._listen(daemon.channel, guard, line, poll) is True
    assert line.descriptor == -1, "no descriptor came with it"
    assert daemon.heard() == []
    assert program._listen(daemon.channel, guard, line, poll) is True
    assert daemon.heard() == [Word.PONG]
    daemon.open_port()
    assert program._listen(daemon.channel, guard, line, poll) is True
    assert line.descriptor >= 0
    daemon.say(Word.CLOSED)
    assert program._listen(daemon.channel, guard, line, poll) is True
    assert line.descriptor == -1
    daemon.end()
    assert program._listen(daemon.channel, guard, line, poll) is False
    assert guard.is_over
    assert poll.poll(0) == [], "the end of the daemon is heard once"


def test_without_a_place_for_the_report_it_is_told_all_the_same(daemon, capfd):
    daemon.say(beat(NEUTRAL, time.monotonic() - 1.0))
    daemon.end()
    program.serve(daemon.channel, None)
    assert "1 neutral and 0 release frames sent" in capfd.readouterr().err


def test_a_daemon_that_flew_and_released_is_followed_by_nothing(daemon, tmp_path, capfd):
    daemon.open_port()
    daemon.say(FRAMES, beat(NEUTRAL, time.monotonic() - 9.0), Word.SAFE, Word.PING, b"")
    daemon.end()
    program.serve(daemon.channel, tmp_path / "guard.json")
    assert daemon.written() == b""
    assert daemon.heard() == [Word.PONG]
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_a_port_that_was_closed_is_not_written_to_and_its_duplicate_is_let_go(daemon):
    daemon.open_port()
    daemon.say(FRAMES, Word.CLOSED, beat(NEUTRAL, time.monotonic()))
    daemon.end()
    program.serve(daemon.channel, None)
    assert daemon.written() == b""
    daemon.port.close()
    assert daemon.board.recv(10) == b"", "nobody holds the other end any more"


def test_what_was_said_is_heard_before_anything_is_decided(daemon):
    """An old heartbeat in front of `SAFE`, as a guard finds them that got no processor for a while."""
    daemon.open_port()
    daemon.say(FRAMES, *[beat(NEUTRAL, time.monotonic() - age) for age in (3.0, 2.0, 1.0)], Word.SAFE)
    daemon.end()
    program.serve(daemon.channel, None)
    assert daemon.written() == b""


def test_a_port_is_not_held_when_the_guard_ends(daemon):
    daemon.open_port()
    daemon.end()
    program.serve(daemon.channel, None)
    daemon.port.close()
    assert daemon.board.recv(10) == b""


@pytest.mark.parametrize("report", [[], ["report.json"]])
def test_it_starts_with_a_channel_and_perhaps_a_place_for_its_report(monkeypatch, daemon, report):
    served, handlers, first = [], {}, []
    channel = os.dup(daemon.channel.fileno())
    os.set_blocking(channel, True)
    monkeypatch.setattr(sys, "argv", ["guard", str(channel), *report])
    monkeypatch.setattr(program, "serve", lambda *what: served.append(what))
    monkeypatch.setattr(program.signal, "signal", handlers.__setitem__)
    monkeypatch.setattr(program, "go_first", lambda: first.append(True))
    program.main()
    [(opened, place)] = served
    assert opened.fileno() == channel
    assert not opened.getblocking()
    assert str(place) == (report[0] if report else "None")
    assert handlers == dict.fromkeys(IGNORED, signal.SIG_IGN)
    assert first == [True]
    opened.close()

"""The guard: a small process that releases the aircraft when the daemon no longer can.

It holds a duplicate of the open port, the encoded neutral and release frames, and hears a heartbeat that every written
stick frame feeds. While the board may obey stick frames, a heartbeat older than `NEUTRAL_AFTER` makes it send neutral
sticks, one older than `RELEASE_AFTER`, or the end of the daemon, the release. It flies nothing, decides nothing else,
cannot be reached from the bus, and needs nothing but the standard library. Source: docs/safety.md, "The guard".

The daemon talks to it over a socket of packets; the first byte of a packet says what it is (`Word`).
"""

from __future__ import annotations

import array
import json
import os
import select
import signal
import socket
import sys
import termios
import time
from contextlib import suppress
from pathlib import Path

NEUTRAL_AFTER = 0.25
"""Neutral sticks are sent when no stick frame was written for this long [s]; docs/safety.md, the ladder."""
NEUTRAL_SPACING = 0.1
"""Between two neutral frames [s]: faster than any board forgets, slower than any board loses frames."""
RELEASE_AFTER = 0.8
"""The release begins when no stick frame was written for this long [s]; leaves 0.3 s until the ladder's 1.1 s."""
RELEASE_SPACING = 0.025
"""Between two release frames [s]: 40 Hz passes a NaviCtrl 0.24 without loss; docs/firmware-notes.md, "Losses"."""
RELEASE_TIME = 1.0
"""The release is repeated for this long [s]: 40 frames, which a burst of lost radio packets does not outlast."""
REAL_TIME = (2, 1)
"""Real-time priorities to ask for, the best first: above the event loop's, or the same; docs/operations.md."""
NICE = -10
"""Priority among ordinary programs, where real time is not granted."""
RESYNC = b"\r\r"
"""Ends a frame that was cut short; the FlightCtrl's receiver does not resynchronise; docs/firmware-notes.md."""


class Word:
    """First byte of a packet. To the guard: PORT to END and PING; from the guard: PONG to RELEASED."""

    PORT = b"P"
    """The open port; its descriptor comes with the packet."""
    CLOSED = b"C"
    """The port is closed: let go of the duplicate, or an unplugged device would keep its name."""
    FRAMES = b"F"
    """JSON list of the release frames, as hexadecimal, in the order they are repeated."""
    BEAT = b"H"
    """A stick or release frame was written; the neutral frame for it follows."""
    SAFE = b"S"
    """The aircraft is released: nothing is owed."""
    END = b"E"
    """The daemon ends in order."""
    PING = b"?"
    """Are you there?"""
    PONG = b"!"
    """Yes."""
    NEUTRAL = b"n"
    """Neutral sticks were sent."""
    RELEASED = b"r"
    """The release was sent."""


class Guard:
    """What is owed to the aircraft, and what to send now; pure, driven with `now` [s; monotonic].

    Attributes:
        is_armed: the board may obey stick frames, so the heartbeat is watched.
        is_over: nothing is left to do.
        neutral_sent: frames with level sticks sent.
        release_sent: release frames sent.
    """

    def __init__(self) -> None:
        self.is_armed = False
        self.is_over = False
        self.neutral_sent = 0
        self.release_sent = 0
        self._release: list[bytes] = []
        self._neutral = b""
        self._beat = 0.0
        self._next = 0.0
        self._release_ends = 0.0
        self._is_late = False
        self._is_orphan = False

    @property
    def is_releasing(self) -> bool:
        """Whether the release has begun; only the daemon's `SAFE` ends that."""
        return self._release_ends > 0

    def hear(self, packet: bytes, now: float) -> None:
        """Take a packet of the daemon; an empty one is the end of it."""
        word, rest = packet[:1], packet[1:]
        if word == Word.FRAMES:
            self._release = [bytes.fromhex(frame) for frame in json.loads(rest)]
        elif word == Word.BEAT:
            if not self.is_releasing:
                self.is_armed, self._is_late, self._neutral = True, False, rest
                self._beat, self._next = now, now + NEUTRAL_AFTER
        elif word == Word.SAFE:
            self.is_armed, self._release_ends = False, 0.0
        elif word == Word.END:
            self.is_armed, self.is_over = False, True
        elif not packet:
            self._is_orphan = True
            self.is_over = not self.is_armed
            self._next = min(self._next, now)

    def due(self, now: float) -> tuple[bytes, ...]:
        """Return the frames to write now, none where nothing is owed."""
        if not self.is_armed or self.is_over or now < self._next:
            return ()
        if self.is_releasing and now >= self._release_ends:
            self.is_over = self._is_orphan
            self._next = float("inf")
            return ()
        resync = () if self._is_late else (RESYNC,)
        must_release = self._is_orphan or now - self._beat >= RELEASE_AFTER
        if not self.is_releasing and not (must_release and self._is_late):
            self._is_late = True
            self._next = now if must_release else min(now + NEUTRAL_SPACING, self._beat + RELEASE_AFTER)
            self._next = max(self._next, now + RELEASE_SPACING)
            self.neutral_sent += 1
            return (*resync, self._neutral)
        if not self.is_releasing:
            self._release_ends = now + RELEASE_TIME
        self._next = now + RELEASE_SPACING
        self.release_sent += 1
        return (self._release[(self.release_sent - 1) % len(self._release)],) if self._release else ()

    def next_time(self) -> float:
        """When `due` has something again [s]; infinite while nothing is owed."""
        return self._next if self.is_armed and not self.is_over else float("inf")


class _Line:
    """The duplicate of the daemon's port."""

    def __init__(self) -> None:
        self.descriptor = -1

    def replace(self, descriptor: int) -> None:
        """Hold another duplicate, or none (-1)."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
        self.descriptor = descriptor

    def discard(self) -> None:
        """Throw away what the kernel has not sent yet; a TCP connection cannot."""
        with suppress(OSError, termios.error):
            termios.tcflush(self.descriptor, termios.TCOFLUSH)

    def write(self, frames: tuple[bytes, ...]) -> bool:
        """Write frames; returns whether the port took them. A port that is full is emptied and tried once more."""
        if self.descriptor < 0:
            return False
        data = b"".join(frames)
        for _ in range(2):
            try:
                return os.write(self.descriptor, data) == len(data)
            except BlockingIOError:
                self.discard()
            except OSError:
                return False
        return False


def serve(channel: socket.socket, report: Path | None) -> None:
    """Watch until the daemon ends or nothing is owed any more.

    Args:
        channel: packets from and to the daemon.
        report: where to write what was done, for the next daemon to read; None for nowhere.
    """
    guard, line = Guard(), _Line()
    poll = select.poll()
    poll.register(channel, select.POLLIN)
    while not guard.is_over:
        left = guard.next_time() - time.monotonic()
        events = poll.poll(None if left == float("inf") else max(0, int(left * 1000) + 1))
        if events:
            _listen(channel, guard, line, poll)
        was_releasing = guard.is_releasing
        frames = guard.due(time.monotonic())
        if frames:
            if guard.is_releasing and not was_releasing:
                line.discard()
            line.write(frames)
            _answer(channel, Word.RELEASED if guard.is_releasing else Word.NEUTRAL)
    line.replace(-1)
    if guard.neutral_sent or guard.release_sent:
        _write_report(f"{guard.neutral_sent} neutral and {guard.release_sent} release frames sent", report)


def _listen(channel: socket.socket, guard: Guard, line: _Line, poll: select.poll) -> None:
    descriptors = array.array("i")
    try:
        packet, ancillary, _, _ = channel.recvmsg(4096, socket.CMSG_SPACE(descriptors.itemsize))
    except BlockingIOError:
        return
    except OSError:
        packet, ancillary = b"", []
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
            descriptors.frombytes(data[: len(data) - len(data) % descriptors.itemsize])
    word = packet[:1]
    if word == Word.PORT and descriptors:
        line.replace(descriptors[0])
    elif word == Word.CLOSED:
        line.replace(-1)
    elif word == Word.PING:
        _answer(channel, Word.PONG)
    if not packet:
        poll.unregister(channel)
    guard.hear(packet, time.monotonic())


def _answer(channel: socket.socket, word: bytes) -> None:
    with suppress(OSError):
        channel.send(word, socket.MSG_DONTWAIT)


def _write_report(text: str, report: Path | None) -> None:
    """Say what was done: in a file for the next daemon, and on stderr, which must not hold us up."""
    if report is not None:
        fresh = report.with_name(f".{report.name}.new")
        with suppress(OSError):
            fresh.write_text(json.dumps({"wall": time.time(), "text": text}), encoding="utf-8")
            fresh.replace(report)
    signal.alarm(1)
    with suppress(OSError):
        os.write(2, f"mkdaemon guard: the daemon stopped while the aircraft was under control; {text}\n".encode())


def go_first(process: int = 0) -> None:
    """Let a process, this one by default, run before ordinary programs and before a loop that never sleeps.

    Without the right to it nothing changes. The guard sleeps until it is needed and then writes 40 frames a second at
    most, so it can starve nobody.
    """
    for priority in REAL_TIME:
        with suppress(OSError, AttributeError):
            os.sched_setscheduler(process, os.SCHED_RR, os.sched_param(priority))
            return
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process, NICE)


def main() -> None:
    """Run as `python -m mkdaemon.guard DESCRIPTOR [REPORT]`, started by the daemon."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)  # whoever ends the daemon must not end the guard before it has acted
    go_first()
    channel = socket.socket(fileno=int(sys.argv[1]))
    channel.setblocking(False)
    serve(channel, Path(sys.argv[2]) if len(sys.argv) > 2 else None)


if __name__ == "__main__":
    main()

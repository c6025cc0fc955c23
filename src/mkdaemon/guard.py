"""The guard: a small process that releases the aircraft when the daemon no longer can.

It holds a duplicate of the open port, the encoded neutral and release frames, and hears a heartbeat that every written
stick frame feeds. While the board may obey stick frames, a heartbeat older than `NEUTRAL_AFTER` makes it send neutral
sticks, one older than `RELEASE_AFTER`, or the end of the daemon, the release. Neutral sticks always go before a
release, however late the guard wakes. It flies nothing, decides nothing else, cannot be reached from the bus, and needs
nothing but the standard library. Source: docs/safety.md, "The guard".

The daemon talks to it over a socket of packets; the first byte of a packet says what it is (`Word`).
"""

from __future__ import annotations

import array
import fcntl
import json
import math
import os
import select
import signal
import socket
import struct
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
FRAME_SPACING = 0.025
"""Least time between two frames, of daemon or guard [s]: a FlightCtrl loses a frame right behind another, and 40 Hz
passes a NaviCtrl 0.24 without loss; docs/firmware-notes.md, "Losses"."""
RELEASE_FRAMES = 40
"""Release frames in all: 1 s of them, which a burst of lost radio packets does not outlast."""
REAL_TIME = (2, 1)
"""Real-time priorities to ask for, the best first: above the event loop's, or the same; docs/operations.md."""
NICE = -10
"""Priority among ordinary programs, where real time is not granted."""
RESYNC = b"\r\r"
"""Ends a frame that was cut short; the FlightCtrl's receiver does not resynchronise; docs/firmware-notes.md."""
IGNORED = (
    *(signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGPIPE),
    *(signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM, signal.SIGTSTP),
)
"""Signals that end the daemon must not end the guard before it has acted."""
_WRITTEN = struct.Struct("<d")
_NEVER = float("inf")


class Word:
    """First byte of a packet. To the guard: PORT to SAFE and PING; from the guard: PONG to RELEASED."""

    PORT = b"P"
    """The open port; its descriptor comes with the packet."""
    CLOSED = b"C"
    """The port is closed: close the duplicate, or an unplugged device would keep its name."""
    FRAMES = b"F"
    """JSON list of the release frames, as hexadecimal, in the order they are repeated."""
    BEAT = b"H"
    """A stick or release frame was written; when [s; monotonic] and the neutral frame for it follow."""
    SAFE = b"S"
    """The aircraft is released: nothing is owed."""
    PING = b"?"
    """Are you there?"""
    PONG = b"!"
    """Yes."""
    NEUTRAL = b"n"
    """Neutral sticks were sent."""
    RELEASED = b"r"
    """The release was sent."""


def beat(neutral: bytes, written: float) -> bytes:
    """Return the packet of a heartbeat.

    Args:
        neutral: frame with level sticks.
        written: when the stick frame was written [s; monotonic, which every process of a machine shares].
    """
    return Word.BEAT + _WRITTEN.pack(written) + neutral


class _Debt:
    """What is owed to an aircraft that may obey stick frames.

    Attributes:
        neutral: the latest stick frame with level sticks.
        beat: when that stick frame was written [s].
        wrote: when the guard wrote last; None before its first neutral frame [s].
        left: release frames to come.
    """

    def __init__(self, neutral: bytes, beat: float) -> None:
        self.neutral = neutral
        self.beat = beat
        self.wrote: float | None = None
        self.left = RELEASE_FRAMES


class Guard:
    """What is owed to the aircraft, and what to send now; pure, driven with `now` [s; monotonic].

    Attributes:
        is_over: nothing is left to do.
        neutral_sent: frames with level sticks sent.
        release_sent: release frames sent.
    """

    def __init__(self) -> None:
        self.is_over = False
        self.neutral_sent = 0
        self.release_sent = 0
        self._release: list[bytes] = []
        self._debt: _Debt | None = None
        self._is_orphan = False

    @property
    def is_armed(self) -> bool:
        """Whether the board may obey stick frames, so that the heartbeat is watched."""
        return self._debt is not None

    @property
    def is_releasing(self) -> bool:
        """Whether the release has begun; only the daemon's `SAFE` ends that."""
        return self._debt is not None and self._debt.left < RELEASE_FRAMES

    def hear(self, packet: bytes, now: float) -> None:
        """Take a packet of the daemon; an empty one is the end of it."""
        word, rest = packet[:1], packet[1:]
        if word == Word.FRAMES:
            self._release = [bytes.fromhex(frame) for frame in json.loads(rest)]
        elif word == Word.BEAT and len(rest) > _WRITTEN.size:
            if not self.is_releasing:
                # As it was written, not as it is heard: a guard that got no processor must not count that as fresh.
                self._debt = _Debt(rest[_WRITTEN.size :], min(_WRITTEN.unpack_from(rest)[0], now))
        elif word == Word.SAFE:
            self._debt = None
        elif not packet:
            self._is_orphan = True
            self.is_over = self._debt is None or not self._debt.left

    def due(self, now: float) -> tuple[bytes, ...]:
        """Return the frames to write now, none where nothing is owed."""
        debt = self._debt
        if debt is None or now < self.next_time():
            return ()
        is_first, must_release = debt.wrote is None, now >= self._release_time(debt)
        debt.wrote = now
        if must_release:
            return self._next_release(debt)
        self.neutral_sent += 1
        return (RESYNC, debt.neutral) if is_first else (debt.neutral,)

    def next_time(self) -> float:
        """When `due` has something again [s]; infinite while nothing is owed."""
        debt = self._debt
        if debt is None or not debt.left:
            return _NEVER
        if debt.wrote is None:
            return debt.beat + (FRAME_SPACING if self._is_orphan else NEUTRAL_AFTER)
        return min(self._release_time(debt), debt.wrote + NEUTRAL_SPACING)

    def _release_time(self, debt: _Debt) -> float:
        """When the next release frame may go: never without neutral sticks before it, however late it is."""
        if debt.wrote is None:
            return _NEVER
        soonest = debt.wrote + FRAME_SPACING
        return soonest if self._is_orphan or self.is_releasing else max(soonest, debt.beat + RELEASE_AFTER)

    def _next_release(self, debt: _Debt) -> tuple[bytes, ...]:
        debt.left -= 1
        self.is_over = self._is_orphan and not debt.left
        if not self._release:
            return ()
        self.release_sent += 1
        return (self._release[(self.release_sent - 1) % len(self._release)],)


class PortLine:
    """A port's descriptor, written to past everything that could hold a program up."""

    def __init__(self) -> None:
        self.descriptor = -1
        self._is_cut = False

    def replace(self, descriptor: int) -> None:
        """Hold another descriptor, or none (-1), and close the one held."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
        self.descriptor, self._is_cut = descriptor, False

    def discard_waiting(self) -> None:
        """Throw away what the device has not sent yet; a TCP connection cannot.

        Only where something waits: a pseudo terminal, which never says that, would throw away what its reader has not
        fetched, neutral sticks among it.
        """
        if self.descriptor < 0:
            return
        waiting = array.array("i", [0])
        with suppress(OSError):
            fcntl.ioctl(self.descriptor, termios.TIOCOUTQ, waiting)
        if waiting[0]:
            self._discard()

    def write(self, frames: tuple[bytes, ...]) -> bool:
        """Write frames; returns whether the port took them. A port that is full is emptied and tried once more."""
        if self.descriptor < 0:
            return False
        for _ in range(2):
            data = b"".join((RESYNC, *frames) if self._is_cut else frames)
            try:
                taken = os.write(self.descriptor, data)
            except BlockingIOError:
                self._discard()
            except OSError:
                return False
            else:
                self._is_cut = taken < len(data)
                return not self._is_cut
        return False

    def _discard(self) -> None:
        with suppress(OSError, termios.error):
            termios.tcflush(self.descriptor, termios.TCOFLUSH)
            self._is_cut = True


def poll_timeout(left: float) -> int | None:
    """Return how long to wait for packets, rounded up [ms]; None for ever, 0 where something is due."""
    return None if left == _NEVER else max(0, math.ceil(left * 1000))


def serve(channel: socket.socket, report: Path | None) -> None:
    """Watch until the daemon ends or nothing is owed any more.

    Args:
        channel: packets from and to the daemon.
        report: where to write what was done, for the next daemon to read; None for nowhere.
    """
    guard, line = Guard(), PortLine()
    poll = select.poll()
    poll.register(channel, select.POLLIN)
    while not guard.is_over:
        events = poll.poll(poll_timeout(guard.next_time() - time.monotonic()))
        # Everything that was said, before anything is decided: the first packet of many may be old.
        while events and _listen(channel, guard, line, poll):
            pass
        was_releasing = guard.is_releasing
        frames = guard.due(time.monotonic())
        if frames:
            if guard.is_releasing and not was_releasing:
                line.discard_waiting()
            line.write(frames)
            _answer(channel, Word.RELEASED if guard.is_releasing else Word.NEUTRAL)
    line.replace(-1)
    if guard.neutral_sent or guard.release_sent:
        _write_report(f"{guard.neutral_sent} neutral and {guard.release_sent} release frames sent", report)


def _listen(channel: socket.socket, guard: Guard, line: PortLine, poll: select.poll) -> bool:
    """Take a packet; returns whether there may be another."""
    descriptors = array.array("i")
    try:
        packet, ancillary, _, _ = channel.recvmsg(4096, socket.CMSG_SPACE(descriptors.itemsize))
    except BlockingIOError:
        return False
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
    return bool(packet)


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
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(1)
    with suppress(OSError):
        os.write(2, f"mkdaemon guard: the daemon stopped while the aircraft was under control; {text}\n".encode())


def go_first(process: int = 0) -> None:
    """Let a process, this one by default, run before ordinary programs and before a loop that never sleeps.

    Without the right to it nothing changes. The guard sleeps until it is needed, and then writes at most 40 frames a
    second, so other programs are not delayed.
    """
    for priority in REAL_TIME:
        with suppress(OSError, AttributeError):
            os.sched_setscheduler(process, os.SCHED_RR, os.sched_param(priority))
            return
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process, NICE)


def main() -> None:
    """Run as `python -m mkdaemon.guard DESCRIPTOR [REPORT]`, started by the daemon."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    go_first()
    channel = socket.socket(fileno=int(sys.argv[1]))
    channel.setblocking(False)
    serve(channel, Path(sys.argv[2]) if len(sys.argv) > 2 else None)


if __name__ == "__main__":
    main()

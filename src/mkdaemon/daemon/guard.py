"""The daemon's side of the guard: starts the process, hands it the port and the frames, feeds it, and knows it alive.

Everything here returns at once: a guard that does not take a packet is as good as none, and that is what `is_alive`
says. See `mkdaemon.guard` for what it does and docs/safety.md, "The guard", for why.
"""

from __future__ import annotations

import array
import asyncio
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import cycle, islice
from pathlib import Path
from typing import Final

from mkdaemon import guard
from mkdaemon.foreignfiles import parse_json, read_text
from mkdaemon.guard import PortLine, Word

PING_PERIOD: Final = 0.2
"""Time between two questions whether it is there [s]."""
SILENCE_LIMIT: Final = 1.0
"""A guard that has not answered for this long counts as dead [s]."""
STOP_LIMIT: Final = 0.5
"""Longest wait for the guard to end after a stop [s]."""
LAST_FRAMES: Final = 10
"""Release frames of a program that ends at once: five in each of two layouts."""
START_LIMIT: Final = 5.0
"""Longest wait for the first answer of a guard that was started [s]; on an idle machine it takes 0.05."""


_LEFT: Final[list[subprocess.Popen[bytes]]] = []
"""Guards that outlive their daemon, because they still have a release to write or have only just begun."""


class GuardProcess:
    """The guard of one daemon.

    Attributes:
        acted: called on the loop when the guard has sent something: True for a release, False for neutral sticks; once
            for each until the daemon writes again.
        changed: called on the loop when it is there, and when it is gone.
    """

    def __init__(self, report: Path | None = None, *, clock: Callable[[], float] = time.monotonic) -> None:
        """Prepare; `start` does the work.

        Args:
            report: file in which the guard says what it did, for the next daemon; None for nowhere.
            clock: the loop's time [s].
        """
        self.acted: Callable[[bool], None] = lambda released: None
        self._reported = b""
        self.changed: Callable[[bool], None] = lambda is_alive: None
        self._report = report
        self._clock = clock
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: socket.socket | None = None
        self._answered = float("-inf")
        self._lost = asyncio.Event()
        self._first_answer = asyncio.Event()

    @property
    def is_alive(self) -> bool:
        """Whether the process runs, listens and has answered lately."""
        return self._channel is not None and self._clock() - self._answered <= SILENCE_LIMIT

    @property
    def pid(self) -> int | None:
        """The process; None before the start."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the process; it outlives this one by as long as a release takes."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            report = [] if self._report is None else [str(self._report)]
            # A script without site packages: it starts in a few milliseconds and imports nothing that could break.
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", guard.__file__, str(theirs.fileno()), *report],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
                cwd="/",
            )
        # It does so itself, but first it has to start: that took seconds beside 25 busy programs.
        guard.go_first(self._process.pid)
        ours.setblocking(False)
        self._channel = ours
        asyncio.get_running_loop().add_reader(ours.fileno(), self._receive_answer)

    async def wait_for_start(self) -> None:
        """Return when it answers for the first time, when it is gone, or after `START_LIMIT`; `is_alive` tells which.

        Until then it would do nothing for an aircraft.
        """
        self._send(Word.PING)
        with suppress(TimeoutError):
            async with asyncio.timeout(START_LIMIT):
                await self._first_answer.wait()

    async def watch(self) -> None:
        """Ask again and again whether it is there, and report every change."""
        was_alive = None
        while True:
            if self.is_alive is not was_alive:
                was_alive = self.is_alive
                self.changed(was_alive)
            self._send(Word.PING)
            with suppress(TimeoutError):
                async with asyncio.timeout(PING_PERIOD):
                    await self._lost.wait()
            self._lost.clear()

    def port_opened(self, descriptor: int) -> None:
        """Hand over a duplicate of an open port."""
        descriptors = array.array("i", [descriptor])
        self._send(Word.PORT, [(socket.SOL_SOCKET, socket.SCM_RIGHTS, descriptors.tobytes())])

    def port_closed(self) -> None:
        """The port is lost or closed: its duplicate must not keep the device's name busy."""
        self._send(Word.CLOSED)

    def frames_changed(self, release: Sequence[bytes]) -> None:
        """Hand over the encoded release frames of every layout that this aircraft may understand."""
        self._send(Word.FRAMES + json.dumps([frame.hex() for frame in release]).encode())

    def frame_written(self, neutral: bytes) -> None:
        """A frame that moves or releases the aircraft was written; `neutral` is the frame for level sticks."""
        self._reported = b""
        self._send(guard.beat(neutral, self._clock()))

    def released(self) -> None:
        """The aircraft is released: nothing is owed."""
        self._send(Word.SAFE)

    async def stop(self) -> None:
        """Let the guard end: at once where nothing is owed, else when it has released. Waits half a second at most."""
        self._hang_up()
        process = self._process
        if process is None:
            return
        loop = asyncio.get_running_loop()
        latest = loop.time() + STOP_LIMIT
        while process.poll() is None and loop.time() < latest:  # noqa: ASYNC110 - a child's end is no event of this loop
            await asyncio.sleep(0.01)
        if process.returncode is None:
            _LEFT.append(process)

    def _send(self, packet: bytes, ancillary: Sequence[tuple[int, int, bytes]] = ()) -> None:
        if self._channel is None:
            return
        try:
            self._channel.sendmsg([packet], ancillary)
        except BlockingIOError:
            return  # it does not read: `is_alive` notices by its silence
        except OSError:
            self._hang_up()

    def _receive_answer(self) -> None:
        if self._channel is None:
            return
        try:
            packet = self._channel.recv(64)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        if not packet:
            self._hang_up()
            return
        self._answered = self._clock()
        self._first_answer.set()
        if packet in (Word.NEUTRAL, Word.RELEASED) and packet != self._reported:
            self._reported = packet
            self.acted(packet == Word.RELEASED)

    def _hang_up(self) -> None:
        channel, self._channel = self._channel, None
        if channel is not None:
            asyncio.get_running_loop().remove_reader(channel.fileno())
            channel.close()
            self._lost.set()
            self._first_answer.set()


class LastWord:
    """The release by a program that must end at once without a guard.

    Hears of one line what a guard hears, and hands it on to the guard.

    Attributes:
        guard: the process; None where there is none.
    """

    def __init__(self) -> None:
        self.guard: GuardProcess | None = None
        self._line = PortLine()
        self._neutral: bytes | None = None
        self._release: Sequence[bytes] = ()

    @property
    def is_guarded(self) -> bool:
        """Whether a guard hears the end of this process, and releases what is owed."""
        return self.guard is not None and self.guard.is_alive

    def port_opened(self, descriptor: int) -> None:
        """Keep a duplicate of an open port: it can be written to whatever became of the original."""
        self._line.replace(os.dup(descriptor))
        if self.guard is not None:
            self.guard.port_opened(descriptor)

    def port_closed(self) -> None:
        """Close the guard's duplicate of the port."""
        self._line.replace(-1)
        if self.guard is not None:
            self.guard.port_closed()

    def frames_changed(self, release: Sequence[bytes]) -> None:
        """Take the encoded release frames of this aircraft."""
        self._release = release
        if self.guard is not None:
            self.guard.frames_changed(release)

    def frame_written(self, neutral: bytes) -> None:
        """A frame that moves or releases the aircraft was written; `neutral` is the frame for level sticks."""
        self._neutral = neutral
        if self.guard is not None:
            self.guard.frame_written(neutral)

    def released(self) -> None:
        """Nothing is owed."""
        self._neutral = None
        if self.guard is not None:
            self.guard.released()

    def speak(self) -> None:
        """Write neutral sticks and the release straight to the port, in 0.3 s, and wait for nothing else.

        Does nothing where nothing is owed. May be called in a signal handler, from wherever the program hangs.
        """
        if self._neutral is None:
            return
        self._line.discard_waiting()
        for frame in (guard.RESYNC + self._neutral, *islice(cycle(self._release), LAST_FRAMES)):
            time.sleep(guard.FRAME_SPACING)
            self._line.write((frame,))


def take_report(path: Path) -> str | None:
    """Return what the guard of an earlier daemon did, and forget it; None where it did nothing."""
    try:
        text = str(parse_json(read_text(path))["text"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    with suppress(OSError):  # a second report is better than none
        path.unlink()
    return text

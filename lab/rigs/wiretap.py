"""A tap on the line between a daemon and its boards: a process of its own that passes bytes on and notes their times.

Run as a program it prints where the daemon may connect, passes everything on to the TCP port it is given, and back,
until its input closes; then it prints what the daemon wrote, one line for each piece: time and bytes in hex.

TCP, because what a pseudo terminal carries waits for a worker of the kernel in either direction (docs/operations.md);
what a program writes to a serial port goes out without one.
"""

from __future__ import annotations

import asyncio
import os
import select
import socket
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Final

from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.messages import ExternControlV2

BAUD: Final = 57600
"""Of the line that stands for the TCP connection, which has no rate of its own."""
BITS: Final = 10
"""A byte on the line: start, eight, stop."""
FIRST: Final = 90
"""Real-time priority, above everything that is measured: the time of a byte must not depend on a busy machine."""
BLOCK: Final = 4096

Piece = tuple[float, bytes]
"""When bytes came out of the daemon [s; monotonic], and which."""
Sticks = tuple[float, ExternControlV2]
"""When a frame of external control had left [s; monotonic], and what it asked for."""


class WireTap:
    """What a daemon wrote.

    Attributes:
        port: where the daemon finds its boards.
        heard: everything it wrote, with its time; complete when the tap has ended.
    """

    def __init__(self, port: str) -> None:
        self.port = port
        self.heard: list[Piece] = []

    def sticks(self) -> list[Sticks]:
        """Stick frames and releases, each with the time at which its last byte has left the line [s; monotonic]."""
        frames = frames_on_wire(self.heard)
        return [(at, ExternControlV2.decode(frame.payload)) for at, frame in frames if frame.id == "b"]


def frames_on_wire(heard: list[Piece]) -> list[tuple[float, Frame]]:
    """Frames and when their last byte has left; a line that is busy with the bytes before holds them up."""
    decoder, found, free = FrameDecoder(), list[tuple[float, Frame]](), float("-inf")
    for at, data in heard:
        for byte in data:
            free = max(free, at) + BITS / BAUD
            found += [(free, item) for item in decoder.feed(bytes((byte,))) if isinstance(item, Frame)]
    return found


@asynccontextmanager
async def tapped(where: str) -> AsyncIterator[WireTap]:
    """A tap in front of a TCP port for as long as the context lasts; what was heard is there afterwards."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(sys.executable, "-m", __name__, where, stdin=pipe, stdout=pipe)
    assert process.stdin is not None and process.stdout is not None
    tap = WireTap((await process.stdout.readline()).decode().strip())
    try:
        yield tap
    finally:
        process.stdin.close()
        said, _ = await process.communicate()
        for line in said.decode().splitlines():
            at, _, data = line.partition(" ")
            tap.heard.append((float(at), bytes.fromhex(data)))


def main(where: str) -> None:
    """Pass bytes on until the input closes; a daemon that opens its port anew gets the boards anew."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(FIRST))
    heard: list[Piece] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(f"tcp:127.0.0.1:{server.getsockname()[1]}", flush=True)
        while server in select.select((server, sys.stdin), (), ())[0]:
            daemon, _ = server.accept()
            host, _, port = where.rpartition(":")
            with daemon, socket.create_connection((host, int(port))) as boards:
                _pass_on(daemon, boards, heard)
    sys.stdout.writelines(f"{at!r} {data.hex()}\n" for at, data in heard)


def _pass_on(daemon: socket.socket, boards: socket.socket, heard: list[Piece]) -> None:
    """Until one of the two hangs up, or the input closes."""
    for one in (daemon, boards):
        one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    with suppress(ConnectionError):
        while True:
            ready, _, _ = select.select((daemon, boards, sys.stdin), (), ())
            if daemon in ready:
                data = daemon.recv(BLOCK)
                heard.append((time.monotonic(), data))
                boards.sendall(data)
            if boards in ready:
                data = boards.recv(BLOCK)
                daemon.sendall(data)
            if sys.stdin in ready or not data:
                return


if __name__ == "__main__":
    main(sys.argv[1])

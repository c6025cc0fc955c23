"""`python -m lab stalled`: a serial server that stands still while a pilot steers: old stick frames that it gathers.

Real time, a TCP connection on this machine, the simulated boards behind it. The server stops reading, as a process
that gets no processor does, while its kernel goes on acknowledging; then it reads on and hands the boards everything.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Annotated, Final

from cyclopts import Parameter

from lab.campaign import Row
from lab.rigs.boardport import Socket
from lab.rigs.linkrig import Log, flight_ctrl, navi_ctrl
from lab.rigs.sticks import build_sticks
from lab.rigs.waiting import PATIENCE, wait_until
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import LinkError
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.link.ports.port import Port

PITCH: Final = 30
"""Of the stick frames [counts]."""
LEAVE: Final = 5.0
"""Longest wait for the server's end, when its client has gone [s]."""
STICK_HZ: Final = 50.0
STEADY: Final = 1.0
"""Steered before the server stands still [s]."""


class StallingServer:
    """Carries bytes between a TCP client and boards, unless it stands still.

    Attributes:
        runs: cleared while it stands still.
        is_deaf: what stands still is only the way to the boards.
        has_ended: set when the client has gone.
    """

    def __init__(self, boards: Socket, *, is_deaf: bool) -> None:
        self.runs = asyncio.Event()
        self.runs.set()
        self.is_deaf = is_deaf
        self.has_ended = asyncio.Event()
        self._boards = boards

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client until it goes."""
        port = await self._boards.open("boards", baud=57600)
        up = asyncio.create_task(self._carry(reader, port))
        try:
            while not up.done():
                chunk = await port.read()
                if not self.is_deaf:
                    await self.runs.wait()
                writer.write(chunk)
                await writer.drain()
        except (OSError, LinkError):
            pass
        finally:
            up.cancel()
            await port.close()
            writer.close()
            self.has_ended.set()

    async def _carry(self, reader: asyncio.StreamReader, port: Port) -> None:
        while True:
            await self.runs.wait()
            chunk = await reader.read(4096)
            await self.runs.wait()
            if not chunk:
                await port.close()
                return
            port.write(chunk)


async def measure(board: str, *, is_deaf: bool, seconds: float) -> Row:
    """Steer into a server that stands still.

    Args:
        seconds: how long it stands still [s].

    Returns:
        How many stick frames were written into it, and after how long the last of them [s].
    """
    loop = asyncio.get_running_loop()
    relay = StallingServer(Socket((flight_ctrl if board == "fc" else navi_ctrl)(), seed=1), is_deaf=is_deaf)
    server = await asyncio.start_server(relay.serve, "127.0.0.1", 0)
    log = Log()
    address = f"tcp:127.0.0.1:{server.sockets[0].getsockname()[1]}"
    link = Link(LinkConfig(port=address), log, motors_running=lambda now, within: False)
    running = asyncio.create_task(link.run(discover))
    try:
        await wait_until(lambda: link.dialect.extern_control is not None, PATIENCE)
        layout = link.dialect.extern_control
        assert layout is not None

        async def steer(until: float) -> None:
            while loop.time() < until:
                link.send_setpoint(build_sticks(layout, pitch=PITCH), deadline=loop.time() + 0.1)
                await asyncio.sleep(1 / STICK_HZ)

        await steer(loop.time() + STEADY)
        relay.runs.clear()
        began = loop.time()
        await steer(began + seconds)
        sticks = [sent for sent in log.tx if sent.message is not None and sent.message.spec.id == "b"]
        written = [sent.at for sent in sticks if sent.at > began and getattr(sent.message, "pitch", 0) == PITCH]
        what = "telemetry goes on" if is_deaf else "nothing passes"
        last = round(max(written, default=began) - began, 2)
        return {"board": board, "what": what, "tilted_frames": len(written), "last_s": last}
    finally:
        relay.runs.set()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        with suppress(TimeoutError):
            async with asyncio.timeout(LEAVE):
                await relay.has_ended.wait()
        server.close()


async def main(
    *,
    seconds: Annotated[float, Parameter(help="How long the server stands still.")] = 4.0,
    as_json: AsJson = False,
) -> int:
    """Measure every combination of board and standstill; about 30 s."""
    found = []
    for board in ("fc", "nc"):
        for is_deaf in (False, True):
            with suppress(TimeoutError):
                found.append(await measure(board, is_deaf=is_deaf, seconds=seconds))
    return show(found, ("board", "what"), as_json=as_json)

"""A gateway as a process, started the way a user starts it."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Final

from lab.rigs.overtarget import favour
from lab.rigs.processes import PROGRAM, cpu_of

START: Final = 120.0
"""Longest start on a machine that is busy [s]."""


class GatewayProcess:
    """One `mkdaemon gateway NAME`.

    Attributes:
        pid: number of its process.
    """

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.pid = process.pid

    def cpu_s(self) -> float:
        """Processor time it has used [s]."""
        return cpu_of(self.pid)


@asynccontextmanager
async def gateway_process(name: str, endpoint: str, vehicle: str, *options: str) -> AsyncIterator[GatewayProcess]:
    """Run a gateway while the context lasts; it serves when the context begins.

    Args:
        name: of the gateway.
        endpoint: of the daemon's bus.
        vehicle: name of the vehicle.
        options: further ones of the gateway.

    Raises:
        TimeoutError: it did not say that it serves.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, *PROGRAM, "gateway", name, "--connect", endpoint, "--vehicle", vehicle, *options),
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    favour(process.pid)
    assert process.stderr is not None
    try:
        async with asyncio.timeout(START):
            while not (line := await process.stderr.readline()).startswith(b"vehicle "):
                if not line:
                    msg = f"the gateway ended: exit code {await process.wait()}"
                    raise TimeoutError(msg)
        yield GatewayProcess(process)
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        rest = await process.stderr.read()
        await process.wait()
        sys.stderr.write(rest.decode(errors="replace"))

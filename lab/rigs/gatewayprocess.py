"""A gateway as a process, started the way a user starts it."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Final

from lab.rigs.overtarget import favour
from lab.rigs.processes import PROGRAM, cpu_of

START: Final = 120.0
"""Longest start on a machine that is busy [s]."""
END: Final = 30.0
"""Longest end [s]."""


@dataclass(slots=True)
class GatewayProcess:
    """One `mkdaemon gateway NAME`.

    Attributes:
        pid: number of its process.
        where: it serves, as it says itself.
        errors: everything it wrote to stderr, complete once it has ended.
        code: how it ended; None while it runs.
    """

    pid: int
    where: str
    errors: str = field(default="")
    code: int | None = None

    def cpu_s(self) -> float:
        """Processor time it has used [s]."""
        return cpu_of(self.pid)


@asynccontextmanager
async def gateway_process(name: str, endpoint: str, vehicle: str, *options: str) -> AsyncIterator[GatewayProcess]:
    """Run a gateway while the context lasts; it serves when the context begins, and ends by SIGTERM.

    Args:
        name: of the gateway.
        endpoint: of the daemon's bus.
        vehicle: name of the vehicle.
        options: further ones of the gateway.

    Raises:
        TimeoutError: it did not say that it serves, or did not end.
    """
    process = await asyncio.create_subprocess_exec(
        *_command(name, endpoint, vehicle, options),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    favour(process.pid)
    assert process.stdout is not None
    assert process.stderr is not None
    reading = asyncio.create_task(process.stderr.read(), name="stderr")
    gateway = GatewayProcess(process.pid, "")
    try:
        async with asyncio.timeout(START):
            line = await process.stdout.readline()
        if not line:
            msg = f"the gateway ended: {(await reading).decode(errors='replace')}"
            raise TimeoutError(msg)
        gateway.where = json.loads(line)["where"]
        yield gateway
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(END):
                gateway.code = await process.wait()
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            gateway.errors = (await reading).decode(errors="replace")
            sys.stderr.write(gateway.errors)


def _command(name: str, endpoint: str, vehicle: str, options: Sequence[str]) -> tuple[str, ...]:
    whose = ("--connect", endpoint, "--vehicle", vehicle, "--json")
    return (sys.executable, *PROGRAM, "gateway", name, *whose, *options)

"""A gateway as a process, started the way a user starts it."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from lab.rigs.overtarget import favour
from lab.rigs.processes import PROGRAM, Program

START: Final = 120.0
"""Longest start on a machine that is busy [s]."""


class GatewayProcess(Program):
    """One `mkdaemon gateway NAME`.

    Attributes:
        where: it serves, as it says itself.
        code: how it ended; None while it runs.
    """

    where = ""
    code: int | None = None


@asynccontextmanager
async def gateway_process(name: str, endpoint: str, vehicle: str, *options: str) -> AsyncIterator[GatewayProcess]:
    """Run a gateway while the context lasts; it serves when the context begins, and ends by SIGTERM.

    Raises:
        TimeoutError: it did not say that it serves.
    """
    whose = ("--connect", endpoint, "--vehicle", vehicle, "--json")
    gateway = await GatewayProcess.start(*PROGRAM, "gateway", name, *whose, *options)
    favour(gateway.pid)
    try:
        async with asyncio.timeout(START):
            line = await gateway.first_line()
        if not line:
            await gateway.end()
            msg = f"the gateway ended: {gateway.errors}"
            raise TimeoutError(msg)
        gateway.where = json.loads(line)["where"]
        yield gateway
    finally:
        gateway.code = await gateway.end()
        sys.stderr.write(gateway.errors)

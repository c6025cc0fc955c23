"""What every attack on a port is flown with: a daemon before a FlightCtrl 2.08 on TCP, and a client."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

from lab.rigs.flown import Flown, flown, observed
from mkdaemon.daemon.priority import favour_loop


@asynccontextmanager
async def daemon_on_tcp(seed: int, *, program: Sequence[str] | None = None, keeps: bool = True) -> AsyncIterator[Flown]:
    """Run a daemon on a FlightCtrl 2.08 while the context lasts.

    Args:
        seed: of the boards.
        program: what Python runs in place of the daemon's own program.
        keeps: whether the simulation keeps what the daemon writes.

    Raises:
        TimeoutError: the daemon did not come up.
    """
    favour_loop()  # who judges must not be starved by the machine's other programs
    simulation = observed(seed, "2.08", keeps=keeps)
    simulation.is_frozen = True  # until the daemon is there: on a busy machine the boards would cost it its start
    async with flown(simulation, on_tcp=True, program=program) as attacked:
        yield attacked

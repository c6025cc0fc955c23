"""Programs of other people before a gateway, each in a process of its own."""

from __future__ import annotations

import asyncio
import sys
from contextlib import asynccontextmanager

from lab.places import ROOT
from lab.rigs.overtarget import favour


@asynccontextmanager
async def running(*arguments, cwd=ROOT, **options):
    """A program of Python that runs, and is killed at the end where it still does."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, *arguments, cwd=cwd, start_new_session=True, **options
    )
    favour(process.pid)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()

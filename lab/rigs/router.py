"""`python -m lab.rigs.router [--config FILE] ENDPOINT...`: a Zenoh router, as `zenohd` is one, until SIGTERM."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path
from typing import Final

from mkdaemon.bus.session import close_session, open_session, session_config

ROUTER: Final = ("-m", "lab.rigs.router")
"""What Python runs to be one."""


async def serve(endpoints: list[str], zenoh_file: Path | None = None) -> None:
    """Route with certificates and access rules until SIGTERM; the first line on stdout says that it listens."""
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    session = await open_session(session_config("router", listen=endpoints, zenoh_file=zenoh_file), listen=endpoints)
    print("listens", flush=True)
    await stop.wait()
    await close_session(session)


if __name__ == "__main__":
    words = sys.argv[1:]
    file = Path(words[1]) if words[:1] == ["--config"] else None
    asyncio.run(serve(words[2:] if file else words, file))

"""`python -m lab.fleet.router ENDPOINT...`: a Zenoh router, as `zenohd` is one, until SIGTERM."""

from __future__ import annotations

import asyncio
import signal
import sys

from mkdaemon.bus.session import close_session, open_session, session_config


async def serve(endpoints: list[str]) -> None:
    """Route until SIGTERM; the first line on standard output says that it listens."""
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    session = await open_session(session_config("router", listen=endpoints), listen=endpoints)
    print("listens", flush=True)
    await stop.wait()
    await close_session(session)


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1:]))

"""The session of a player: on it nothing is asked and nothing is streamed."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import zenoh

from mkdaemon.bus.session import close_session, open_session, session_config


@asynccontextmanager
async def open_player_session(
    *, connect: Sequence[str], listen: str | None, zenoh_file: Path | None = None
) -> AsyncIterator[zenoh.Session]:
    """Open a session for a player of recordings, and close it on leaving.

    Args:
        connect: endpoint of a daemon or of a router, where clients meet.
        listen: endpoint for clients, where nothing else is there.
        zenoh_file: Zenoh configuration, for TLS.

    Raises:
        MkError: nobody listens at the endpoint, or the one to listen at is in use.
        ConfigError: an endpoint or the file cannot be understood.
    """
    if listen is None:
        config = session_config("client", connect=connect, zenoh_file=zenoh_file)
    else:
        config = session_config("peer", listen=[listen], zenoh_file=zenoh_file)
    session = await open_session(config, listen=() if listen is None else [listen])
    try:
        yield session
    finally:
        await close_session(session)

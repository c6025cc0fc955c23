"""A simulator's Zenoh session: a client of the daemon, opened again and again until one listens."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Awaitable, Callable, Sequence

import zenoh

from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.errors import ConfigError, MkError

_RETRY = 2.0
_PATIENCE_TIME = 0.5
"""Longest attempt to connect to a daemon; the program's end waits for it."""
_ENDPOINT = re.compile(r"[a-z_]+/\S+")


def check_endpoints(connect: Sequence[str]) -> None:
    """Refuse what is no endpoint.

    Raises:
        ConfigError: an endpoint cannot be understood.
    """
    for endpoint in connect:
        if not _ENDPOINT.fullmatch(endpoint):
            msg = f"sim.connect '{endpoint}': give an endpoint like tcp/127.0.0.1:7447"
            raise ConfigError(msg)


async def stay_connected(connect: Sequence[str], serve: Callable[[zenoh.Session], Awaitable[None]]) -> None:
    """Serve on every session that can be opened, for ever; at once over without endpoints.

    Args:
        connect: endpoints.
        serve: runs until it is cancelled.
    """
    if not connect:
        return
    while True:
        try:
            # shielded: a session that opens after we were cancelled must still be closed
            opening = asyncio.ensure_future(
                open_session(session_config("client", connect=connect, patience=_PATIENCE_TIME))
            )
            session = await asyncio.shield(opening)
        except asyncio.CancelledError:
            await _close_late(opening)
            raise
        except MkError:
            await asyncio.sleep(_RETRY)
            continue
        try:
            await serve(session)
        finally:
            await asyncio.shield(close_session(session))


async def _close_late(opening: asyncio.Future[zenoh.Session]) -> None:
    with contextlib.suppress(MkError):
        await close_session(await opening)

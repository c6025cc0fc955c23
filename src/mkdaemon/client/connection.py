"""How a program finds a vehicle: name, endpoint, environment."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from mkdaemon.bus.session import ENDPOINT_SAMPLE, close_session, open_session, session_config
from mkdaemon.client.vehicle import Vehicle
from mkdaemon.config.names import require_vehicle_name

DEFAULT_VEHICLE: Final = "mk1"
DEFAULT_ENDPOINT: Final = ENDPOINT_SAMPLE


@asynccontextmanager
async def connect(
    vehicle: str | None = None, endpoint: str | None = None, *, zenoh_file: Path | None = None
) -> AsyncIterator[Vehicle]:
    """Connect to the daemon of a vehicle, and close the session on leaving.

    Args:
        vehicle: its name; else the environment's `MK_VEHICLE`, else `mk1`.
        endpoint: Zenoh endpoint of the daemon or of a router; else `MK_CONNECT`, else `tcp/127.0.0.1:7447`.
        zenoh_file: Zenoh configuration of this client, for TLS; else `MK_ZENOH_FILE`, else none.

    Raises:
        MkError: no daemon listens at the endpoint.
        ConfigError: the endpoint, the file or the vehicle's name is invalid.
    """
    name = vehicle or os.environ.get("MK_VEHICLE") or DEFAULT_VEHICLE
    where = endpoint or os.environ.get("MK_CONNECT") or DEFAULT_ENDPOINT
    file = zenoh_file or (Path(given) if (given := os.environ.get("MK_ZENOH_FILE")) else None)
    require_vehicle_name(name, "--vehicle")
    session = await open_session(session_config("client", connect=[where], zenoh_file=file))
    try:
        yield Vehicle(session, name, where)
    finally:
        await close_session(session)

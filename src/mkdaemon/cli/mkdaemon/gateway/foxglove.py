"""`mkdaemon gateway foxglove`: Foxglove and Lichtblick look at a vehicle, live or played."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import Port
from mkdaemon.cli.extras import needing
from mkdaemon.cli.interrupts import until_asked_to_end
from mkdaemon.cli.mkdaemon.gateway.greeting import announce_serving
from mkdaemon.cli.promptness import fast_loop, favour_threads
from mkdaemon.client import connect as connect_client
from mkdaemon.client.connection import DEFAULT_ENDPOINT, DEFAULT_VEHICLE
from mkdaemon.config.names import require_vehicle_name


def foxglove(
    *,
    vehicle: Annotated[tuple[str, ...], Parameter(env_var="MK_VEHICLE")] = (DEFAULT_VEHICLE,),
    connect: Annotated[str, Parameter(env_var="MK_CONNECT")] = DEFAULT_ENDPOINT,
    zenoh_file: Annotated[Path | None, Parameter(env_var="MK_ZENOH_FILE")] = None,
    host: str = "127.0.0.1",
    port: Port = 8765,
    json: bool = False,
) -> None:
    """Show vehicles to Foxglove and Lichtblick: a WebSocket server with the schemas they know, and every key as JSON.

    It only reads. A vehicle is shown live, or as `mkctl log play` plays it; it may come later than its viewers. Nothing
    is subscribed on the bus that no viewer looks at. Layouts are in configs/foxglove. Ctrl-C ends it. Needs the extra
    `foxglove`: pip install 'mkdaemon[foxglove]'.

    Example: mkdaemon gateway foxglove --vehicle mk1 --vehicle mk2

    Args:
        vehicle: Name of a vehicle; of several, once for each: then topics and frames begin with it.
        connect: Zenoh endpoint of the daemon or of a router.
        zenoh_file: Zenoh configuration of this client, for TLS: configs/zenoh/.
        host: Address to listen at; at any other than 127.0.0.1, every machine that reaches it can look.
        port: To listen at; 0 for any that is free.
        json: Print JSON, one object a line, in place of text.

    Raises:
        MkError: no daemon or player at the endpoint.
        ConfigError: foxglove-sdk is not installed, the address cannot be used, or a name is none.
    """
    with needing("mkdaemon gateway foxglove", "foxglove-sdk", "foxglove"):
        import_module("mkdaemon.gateways.foxglove.server")
    for name in vehicle:
        require_vehicle_name(name, "--vehicle")
    favour_threads()
    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        runner.run(_serve(tuple(dict.fromkeys(vehicle)), connect, zenoh_file, (host, port), as_json=json))


async def _serve(
    vehicles: Sequence[str], endpoint: str, zenoh_file: Path | None, address: tuple[str, int], *, as_json: bool
) -> None:
    """Serve viewers until it is asked to end."""
    from mkdaemon.gateways.foxglove.server import serving

    async with (
        connect_client(vehicles[0], endpoint, zenoh_file=zenoh_file) as uav,
        serving(uav, vehicles, *address) as where,
    ):
        announce_serving("foxglove", vehicles, where, as_json=as_json)
        await until_asked_to_end()

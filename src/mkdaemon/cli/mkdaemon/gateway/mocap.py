"""`mkdaemon gateway mocap`: a motion capture system reports where vehicles are."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mkdaemon.cli.extras import needing
from mkdaemon.cli.interrupts import run_until_asked_to_end
from mkdaemon.cli.mkdaemon.gateway.greeting import announce_serving
from mkdaemon.cli.promptness import fast_loop, favour_threads
from mkdaemon.client import connect as connect_client
from mkdaemon.client.connection import DEFAULT_ENDPOINT, DEFAULT_VEHICLE
from mkdaemon.config.camera import read_image_secret
from mkdaemon.errors import ConfigError

if TYPE_CHECKING:
    from mkdaemon.gateways.mocap.gateway import Body


def mocap(
    system: str,
    host: str,
    *,
    body: Annotated[tuple[str, ...], Parameter(consume_multiple=False)] = (),
    secret_file: Path | None = None,
    latency_ms: float = 3.0,
    connect: Annotated[str, Parameter(env_var="MK_CONNECT")] = DEFAULT_ENDPOINT,
    zenoh_file: Annotated[Path | None, Parameter(env_var="MK_ZENOH_FILE")] = None,
    json: bool = False,
) -> None:
    """Report the poses of a motion capture system to vehicles: `[[positions]]` of their configuration takes them.

    It never flies and takes no lease. A body that is hidden is not reported; a system that is lost is reached again.
    Ctrl-C ends it. Needs the extra `mocap`: pip install 'mkdaemon[mocap]'.

    Example: mkdaemon gateway mocap vicon 192.168.1.10 --body mk1=mk1 --secret-file mocap.secret

    Args:
        system: `vicon`, `optitrack`, `qualisys`, `vrpn` or `fzmotion`.
        host: Name or address of the system.
        body: `BODY=VEHICLE` or `BODY=VEHICLE/SOURCE`: a body of the system and whom it is reported to; the source is
            `mocap` unless given. Once for each body.
        secret_file: File with the secret of `secret_file` of the source; the same for all bodies.
        latency_ms: Time from a measurement to its arrival here [ms]; the data sheet of the system has it.
        connect: Zenoh endpoint of the daemon or of a router.
        zenoh_file: Zenoh configuration of this client, for TLS: configs/zenoh/.
        json: Print JSON, one object a line, in place of text.

    Raises:
        ConfigError: motioncapture is not installed, or an option cannot be used.
        MkError: no daemon at the endpoint.
    """
    from mkdaemon.gateways.mocap.reader import frames_apart
    from mkdaemon.gateways.mocap.systems import find_system

    chosen = find_system(system)
    if not body:
        raise ConfigError("--body BODY=VEHICLE: name at least one body and its vehicle")
    wanted = [_body_of(each) for each in body]
    if not 0.0 <= latency_ms <= 500.0:
        raise ConfigError(f"--latency-ms {latency_ms:g}: give the time of the system, 0 to 500")
    secret = None if secret_file is None else read_image_secret(secret_file)
    with needing("mkdaemon gateway mocap", "motioncapture", "mocap", "motioncapture"):
        import_module("motioncapture")
    where, frames = f"{chosen.word} at {host}", partial(frames_apart, chosen, host)

    async def serve() -> None:
        from mkdaemon.gateways.mocap.gateway import MocapGateway

        async with AsyncExitStack() as stack:
            bodies = [await stack.enter_async_context(_reported(*each, connect, zenoh_file, secret)) for each in wanted]
            show = partial(print, file=sys.stderr, flush=True)
            gateway = MocapGateway(where, frames, bodies, latency_ms / 1000.0, show)
            favour_threads()
            announce_serving("mocap", [vehicle for _, vehicle, _ in wanted], where, as_json=json)
            await gateway.run()

    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        runner.run(run_until_asked_to_end(serve()))


@asynccontextmanager
async def _reported(
    name: str, vehicle: str, source: str, endpoint: str, zenoh_file: Path | None, secret: str | None
) -> AsyncIterator[Body]:
    """A body and its vehicle, which is connected while the context lasts."""
    from mkdaemon.client.positions import PositionSender
    from mkdaemon.gateways.mocap.gateway import Body

    async with connect_client(vehicle, endpoint, zenoh_file=zenoh_file) as uav:
        yield Body(name, source, PositionSender(uav, source, secret))


def _body_of(text: str) -> tuple[str, str, str]:
    """Body, vehicle and source of `BODY=VEHICLE[/SOURCE]`."""
    name, _, whom = text.partition("=")
    vehicle, _, source = whom.partition("/")
    if not name or not whom:
        raise ConfigError(f"--body {text!r}: write BODY=VEHICLE, for example drone7={DEFAULT_VEHICLE}")
    return name, vehicle, source or "mocap"

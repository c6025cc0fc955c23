"""`mkdaemon gateway mavlink`: QGroundControl, MAVSDK and MAVProxy meet a MikroKopter."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.extras import needing
from mkdaemon.cli.interrupts import run_until_asked_to_end
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkdaemon.gateway.greeting import announce_serving
from mkdaemon.cli.program import let_signals_kill
from mkdaemon.cli.promptness import fast_loop, favour_threads


def mavlink(
    *,
    link: Annotated[tuple[str, ...], Parameter(consume_multiple=False)] = (),
    system: int = 1,
    signing_key: Path | None = None,
    allow_open: bool = False,
    backups: Path | None = None,
    target: str = "",
    connection: Connection = HERE,
) -> None:
    """Show a vehicle to ground stations in MAVLink 2, and fly it for them: docs/mavlink.md says what maps.

    It takes the lease only when a ground station asks to fly, and gives it back when none flies any more. Needs the
    extra `mavlink`: pip install 'mkdaemon[mavlink]'.

    Example: mkdaemon gateway mavlink --link udpout:127.0.0.1:14550

    Args:
        link: Where ground stations are met: `udpout:HOST:PORT`, `udpin:HOST:PORT`, `tcpin:HOST:PORT`,
            `tcpout:HOST:PORT` or `serial:DEVICE:BAUD`; with `,ardupilot` behind it for MAVProxy, whose modes have
            ArduPilot's numbers; with `,as-px4` for the buttons of QGroundControl. Give it once for each. Without it
            `udpout:127.0.0.1:14550` and `tcpin:127.0.0.1:5760`.
        system: Number of the aircraft on the MAVLink network.
        signing_key: File of the key that signs messages: 64 hexadecimal digits, or a passphrase. What is not signed
            with it is dropped.
        allow_open: Accept any program in the network without a key; each of them can fly.
        backups: Folder in which the settings are saved before a ground station first changes one.
        target: Name of the target, or place of a map, that is flown by. Without it the one in sight, which is refused
            where there are several.

    Raises:
        ConfigError: pymavlink is not installed, or an option cannot be used.
    """
    with needing("mkdaemon gateway mavlink", "pymavlink", "mavlink", "pymavlink"):
        from mkdaemon.gateways.mavlink.program import options_from, serve
    options = options_from(link, system, signing_key, backups, allow_open=allow_open, target=target)

    def serving() -> None:
        favour_threads()
        where = f"{', '.join(map(str, options.addresses))} as system {options.system}"
        announce_serving("mavlink", (connection.vehicle,), where, as_json=connection.json)

    let_signals_kill()
    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        runner.run(run_until_asked_to_end(serve(connection.open, options, serving)))

"""`mkctl top`: a vehicle, or all of them, on one screen of a terminal, live."""

from __future__ import annotations

import sys
from contextlib import AbstractAsyncContextManager
from dataclasses import replace
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.extras import needing
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.release import release_somehow
from mkdaemon.client import Vehicle
from mkdaemon.errors import ConfigError


async def top(
    *,
    fleet: Annotated[bool, Parameter(name="--all", help="A row for each vehicle of this endpoint.")] = False,
    connection: Connection = HERE,
) -> None:
    """Show a vehicle on one screen of 80 x 24, also over ssh: health, attitude, battery, link, vision, holder, events.

    Keys: `r` releases, `l` lands on the target in sight, both after a question; `v` chooses another vehicle, `q` ends.
    With `--all`, all vehicles: holder, link, battery, place; a vehicle that has gone stays, with the time since.
    What is stale says so, with its age. Needs the extra `top`: pip install 'mkdaemon[top]'.

    Example: mkctl top --vehicle mk2

    Raises:
        ConfigError: there is no terminal, or textual is not installed.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("mkctl top needs a terminal; `mkctl status` prints once")
    with needing("mkctl top", "textual", "top", "textual"):
        from mkdaemon.view.top.terminalapp import FleetApp, TopApp

    if fleet:
        await FleetApp(connection.open).run_async()
        return

    def of(vehicle: str) -> Connection:
        return replace(connection, vehicle=vehicle)

    def open_vehicle(vehicle: str) -> AbstractAsyncContextManager[Vehicle]:
        return of(vehicle).open()

    async def release(vehicle: str) -> str:
        return (await release_somehow(of(vehicle), "asked for in mkctl top")).status.words

    async def land(vehicle: str) -> str:
        async with of(vehicle).open() as uav, uav.lease(force=True) as lease:
            await lease.land()
            return lease.reason

    await TopApp(connection.vehicle, open_vehicle, release=release, land=land).run_async()

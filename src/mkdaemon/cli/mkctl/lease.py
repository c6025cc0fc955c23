"""`mkctl lease`: the right to fly."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import App, Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.telemetry.control import LeaseGrant, LeaseState

app: Final = App(
    name="lease",
    help="The right to fly: one client at a time holds it. Only a client with its secret can stream setpoints.",
)


@app.command
async def take(
    *,
    holder: str | None = None,
    ttl: Annotated[float | None, Parameter(help="Life without setpoints [s], if shorter than configured.")] = None,
    force: Annotated[bool, Parameter(help="Take it from its holder.")] = False,
    use_remembered: Annotated[
        bool, Parameter(help="Assume the FlightCtrl of before, which cannot be identified in flight.")
    ] = False,
    connection: Connection = HERE,
) -> None:
    """Take the lease and print its epoch, its secret and where setpoints are put.

    It ends by itself when none follow; `mkctl release` ends it at once.

    Example: mkctl lease take --ttl 2

    Args:
        holder: Name others see; default: user, machine and process.
    """
    async with connection.open() as uav:
        granted = await uav.lease.take(force=force, ttl=ttl, holder=holder, use_remembered=use_remembered)
    _show(granted, connection)


@app.command
async def show(*, connection: Connection = HERE) -> None:
    """Show the holder of the lease.

    Example: mkctl lease show
    """
    async with connection.open() as uav:
        found = await uav.lease.show()
    _show(found, connection)


def _show(lease: LeaseState | None, connection: Connection) -> None:
    if lease is None:
        connection.show({"holder": None}, "no client holds the lease")
        return
    words = f"{lease.holder} holds the lease: epoch {lease.epoch}, {lease.left:.1f} s left"
    if isinstance(lease, LeaseGrant):
        words += f"\nsecret {lease.secret}\nsetpoints are put below {lease.setpoint_root}"
    connection.show(dict(lease), words)

"""`mkctl lease`: the right to fly."""

from __future__ import annotations

from typing import Annotated, Any, Final

from cyclopts import App, Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.client.identity import client_name

app: Final = App(
    name="lease",
    help="The right to fly: one client at a time holds it. Only who knows its secret can stream setpoints under it.",
)


@app.command
async def take(
    *,
    holder: str | None = None,
    ttl: Annotated[float | None, Parameter(help="Life without setpoints [s], if shorter than configured.")] = None,
    force: Annotated[bool, Parameter(negative=(), help="Take it from whoever holds it.")] = False,
    use_remembered: Annotated[
        bool, Parameter(negative=(), help="The FlightCtrl, which cannot be asked in flight, is the one before.")
    ] = False,
    connection: Connection = HERE,
) -> None:
    """Take the lease and print its epoch and secret; it ends by itself when no setpoints follow.

    Args:
        holder: Name others see; default: user, machine and process.
    """
    fields: dict[str, Any] = {"action": "take", "holder": holder or client_name(), "force": force}
    if ttl is not None:
        fields["ttl"] = ttl
    if use_remembered:
        fields["use_remembered"] = True
    await _lease(fields, connection)


@app.command
async def release(epoch: int, secret: str, *, connection: Connection = HERE) -> None:
    """Give the lease back; the aircraft is released.

    Args:
        epoch: As `take` printed it.
        secret: As `take` printed it.
    """
    await _lease({"action": "release", "epoch": epoch, "secret": secret}, connection)


@app.command
async def show(*, connection: Connection = HERE) -> None:
    """Show who holds the lease."""
    await _lease({"action": "show"}, connection)


async def _lease(fields: dict[str, Any], connection: Connection) -> None:
    async with connection.open() as client:
        is_taking = fields["action"] == "take"
        answer = await (client.ask_for_lease(fields) if is_taking else client.command("do", "lease", fields))
        reply = answer.require()
    if connection.json:
        print(json_line(reply or {"holder": None}))
    elif reply:
        print(f"{reply['holder']} holds the lease: epoch {reply['epoch']}, {reply['left']:.1f} s left")
        if "secret" in reply:
            print(f"secret {reply['secret']}")
    else:
        print("nobody holds the lease")

"""`mkctl preflight --gains`: the model of the aircraft, its gains, and the model error that they tolerate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rich.table import Table

from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.connection import Connection

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import Gains


async def show_gains(connection: Connection) -> None:
    """Show model, gains and margins of the control loop.

    The model is that of the factory's set 3 until a client takes the lease. Then the daemon reads the active parameter
    set, if a cable leads to the FlightCtrl. The margins are those of a loop that knows the true state, with
    the configured rate and limits. A configuration that is not safe on the model is refused when the daemon starts, and
    by `mkctl preflight` where only this aircraft's own set shows it.

    Raises:
        MkError: no daemon.
    """
    async with connection.open() as uav:
        found = await uav.gains()
    if not connection.json:
        Console().print(_table(found))
    connection.show({**dict(found), "is_safe": found.is_safe}, _JUDGEMENT[found.is_safe])


_JUDGEMENT: Final = {
    True: "safe: the loop bears all that it has to bear",
    False: "NOT safe: `mkctl preflight` names the cause and the remedy; no flight against a target begins",
}


def _table(found: Gains) -> Table:
    """The model, and its margins beside their bounds."""
    table = Table("what", "value", "must be", width=96)
    for words, value in (
        ("tilt that a stick count asks for (deg)", found.degrees_per_count),
        ("attitude loop, proportional gain (1/s)", found.a1),
        ("attitude loop, integral gain (1/s2)", found.a2),
        ("leak of the FlightCtrl's tilt (s)", found.leak),
        ("stick filter (s)", found.stick_filter),
        ("uplink (s)", found.uplink),
        *((f"gain on {name}", value) for name, value in found.gains.items()),
    ):
        table.add_row(words, f"{value:.4g}")
    (low, high), (least, most) = found.gain_margin, found.needed_gain
    farthest = f"at most {found.farthest_rest:.2g}"
    table.add_row("spectral radius over a control period", f"{found.radius:.4g}", "below 1")
    table.add_row(
        "stable with a stick gain over the model's of", f"{low:.2f} to {high:.2f}", f"{least} to {most}, or more"
    )
    table.add_row(
        "additional delay that stays stable (s)", f"{found.delay_margin:.2f}", f"at least {found.needed_delay:.2g}"
    )
    table.add_row("end of a flight on the model, beside its goal (m)", f"{found.rest_level:.2g}", farthest)
    table.add_row("the same, above or below (m)", f"{found.rest_height:.2g}", farthest)
    return table

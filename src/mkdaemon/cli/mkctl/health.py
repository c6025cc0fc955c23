"""`mkctl health`: the link, live."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mkdaemon.cli.arguments import Length
from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.sparkline import sparkline
from mkdaemon.errors import MkError
from mkdaemon.telemetry.link import Fates, LinkCondition, fates_of
from mkdaemon.telemetry.tone import Tone

KEY = "link/health"
_COLOURS: Final = {one.value: {Tone.OK: "green", Tone.WARN: "yellow"}.get(one.tone, "red") for one in LinkCondition}
MINUTE: Final = 300
"""Measurements in it, at 5 Hz."""
BARS: Final = 16
"""Of a trend."""


async def health(*, once: bool = False, seconds: Length | None = None, connection: Connection = HERE) -> None:
    """Show the link as it is: state and reason, round trips, losses, every stream against what was asked.

    Example: mkctl health --once

    Args:
        once: Print what is known now and end; this is also what happens without a terminal.
        seconds: End after this time [s].

    Raises:
        MkError: nothing has been measured: no daemon, or not this vehicle's.
        ConfigError: `seconds` is not above 0.
    """
    console = Console()
    async with connection.open() as client:
        if connection.json or once or not console.is_terminal:
            sample = await client.get(KEY)
            if sample is None:
                raise MkError(await client.absence() or f"vehicle {connection.vehicle} has no link measurements yet")
            if connection.json:
                print(json_line(sample.fields))
            else:
                console.print(render(sample.fields))
            return
        with Live(Text("waiting for the daemon ..."), console=console, refresh_per_second=5) as live:
            async with client.watch(KEY) as samples:
                if (absence := await client.absence()) is not None:
                    live.update(Text(f"{absence}; waiting for it"))
                with suppress(TimeoutError):
                    minute: deque[Mapping[str, Any]] = deque(maxlen=MINUTE)
                    async with asyncio.timeout(seconds):
                        async for sample in samples:
                            minute.append(sample.fields)
                            live.update(render(sample.fields, minute))


def render(fields: Mapping[str, Any], minute: Sequence[Mapping[str, Any]] = ()) -> Group:
    """The screen.

    Args:
        fields: what was measured last.
        minute: what was measured in the last minute, in order; with two or more their trends are shown.
    """
    state = fields["state"]
    colour = _COLOURS.get(state["condition"], "red")
    head = Text.assemble((f"{state['condition']} ", f"bold {colour}"), state["reason"])
    ears = f"we hear the board: {_yes(state['hears_board'])}; it hears us: {_yes(state['board_hears_us'])}"
    where = f"{state['port']}, {state['baud']} baud; {state['firmware'] or 'firmware unknown'}"
    tables = (_round_trips(fields, minute), _fates(fields), _streams(fields["kinds"]))
    return Group(head, Text(ears), Text(where, style="dim"), *tables)


def _yes(value: bool) -> str:
    return "yes" if value else "NO"


def _round_trips(fields: Mapping[str, Any], minute: Sequence[Mapping[str, Any]]) -> Table:
    table = Table("round trip", "sent", "lost", "loss", "p50 ms", "p95 ms", "p99 ms", "late", "twice")
    has_trend = len(minute) > 1
    if has_trend:
        table.add_column("p95, last minute", no_wrap=True)
    for name, title in (("echo", "link test"), ("confirm", "stick frames")):
        trip = fields[name]
        times = ("-" if trip[key] is None else f"{trip[key]:.1f}" for key in ("p50_ms", "p95_ms", "p99_ms"))
        loss = f"{trip['loss_percent']:.2f} %"
        counts = (str(trip["late"]), str(trip["duplicate"]))
        trend = [sparkline([one[name]["p95_ms"] for one in minute], BARS)] if has_trend else []
        table.add_row(title, str(trip["sent"]), str(trip["lost"]), loss, *times, *counts, *trend)
    return table


def _fates(fields: Mapping[str, Any]) -> Table:
    """What became of everything that was sent since the start; nothing is left out."""
    table = Table("since the start", *Fates.model_fields)
    for title, fates in fates_of(fields).items():
        table.add_row(title, *(str(count) for _, count in fates))
    return table


def _streams(kinds: list[Mapping[str, Any]]) -> Table:
    table = Table("frame", "board", "frames", "Hz", "asked Hz", "age s", "")
    for kind in kinds:
        asked = "-" if kind["asked_rate"] is None else f"{kind['asked_rate']:.1f}"
        stale = Text("STALE", style="bold red") if kind["is_stale"] else Text("")
        numbers = (str(kind["frames"]), f"{kind['rate']:.1f}", asked, f"{kind['age']:.2f}")
        table.add_row(kind["key"], kind["board"], *numbers, stale)
    return table

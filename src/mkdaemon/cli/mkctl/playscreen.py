"""The progress bar and the keys of a player."""

from __future__ import annotations

import asyncio
import os
import sys
import termios
import tty
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Final

from mkdaemon.client.player import Player
from mkdaemon.telemetry.play import PlayState

DRAW: Final = 0.1
"""Time between two pictures of the bar [s]."""
FACTOR: Final = 2.0
"""Of the speed, with one key."""
LEGEND: Final = "space pause, n step, + faster, - slower, q end"


def key_pressed(player: Player, key: str) -> None:
    """Do what a key asks for; others are ignored.

    Args:
        player: what plays.
        key: one character.
    """
    match key:
        case " ":
            player.adjust(lambda pace, now: pace.toggle(now))
        case "n":
            player.adjust(lambda pace, now: pace.step(now))
        case "+" | "=":
            player.adjust(lambda pace, now: pace.change_speed(FACTOR, now))
        case "-":
            player.adjust(lambda pace, now: pace.change_speed(1 / FACTOR, now))
        case "q":
            player.stop()
        case _:
            return


@asynccontextmanager
async def showing_player(player: Player, *, quiet: bool) -> AsyncIterator[None]:
    """Show a bar and take keys while the context lasts; nothing when `quiet` or no terminal is there."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    console = Console(stderr=True)
    is_shown = not quiet and console.is_terminal
    columns = (BarColumn(), TextColumn("{task.description}"), TextColumn(LEGEND, style="dim"))
    with Progress(*columns, console=console, transient=True, disable=not is_shown) as bars, _keys(player, is_shown):
        drawing = asyncio.create_task(_draw(player, bars.update, bars.add_task("", total=None)), name="bar")
        try:
            yield
        finally:
            drawing.cancel()
            await asyncio.gather(drawing, return_exceptions=True)


async def _draw(player: Player, update: Callable[..., None], task: object) -> None:
    while True:
        status = player.status()
        text = f"{status.place:.1f} of {status.length:.1f} s, {status.speed:g} times, {status.sent} values"
        text += ", paused" if status.state is PlayState.PAUSED else ""
        update(task, total=status.length or 1.0, completed=status.place, description=text)
        await asyncio.sleep(DRAW)


@contextmanager
def _keys(player: Player, is_shown: bool) -> Iterator[None]:
    """Take keys without Return; the terminal is as before afterwards."""
    if not (is_shown and sys.stdin.isatty()):
        yield
        return
    loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()
    before = termios.tcgetattr(terminal)

    def read() -> None:
        for key in os.read(terminal, 32).decode("latin-1") or "q":
            key_pressed(player, key)

    try:
        tty.setcbreak(terminal)
        loop.add_reader(terminal, read)
        yield
    finally:
        loop.remove_reader(terminal)
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)

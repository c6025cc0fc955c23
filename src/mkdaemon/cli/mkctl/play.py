"""`mkctl log play`: a recording on the bus again, for viewers and scripts."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, nullcontext
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from mkdaemon.cli.arguments import Length
from mkdaemon.cli.keyreader import taking_keys
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.log import reading_progress
from mkdaemon.cli.mkctl.logtime import moment_of
from mkdaemon.cli.printing import picked, show
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.promptness import favour_threads
from mkdaemon.client.player import Player
from mkdaemon.client.taskerrors import background
from mkdaemon.config.names import require_vehicle_name
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayState

if TYPE_CHECKING:
    from mkdaemon.client.player import Player


async def play(
    file: Path,
    /,
    *,
    speed: Annotated[Length, Parameter(name=["--speed", "-s"])] = 1.0,
    start: Annotated[str | None, Parameter(name="--from", allow_leading_hyphen=True)] = None,
    end: Annotated[str | None, Parameter(name="--to", allow_leading_hyphen=True)] = None,
    loop: bool = False,
    step: bool = False,
    key: Annotated[tuple[str, ...], Parameter(name=["--key", "-k"])] = (),
    name: Annotated[str | None, Parameter(name="--as")] = None,
    listen: str | None = None,
    wait: Annotated[float, Parameter(name=["--wait", "-w"])] = 10.0,
    connection: Connection = HERE,
) -> int:
    """Put the published values of a recording on the bus again, each at its time, byte by byte.

    They stand under `replay/<vehicle>/...`, or with --as under `mk/<name>/...`, as from a daemon of that name: then
    `mkctl --vehicle <name>` with status, health, get and watch shows the vehicle as it was at that moment, and every
    command is refused. Setpoints and requests are never played, nor under the name of a live daemon. Exit code 1 when
    not all was put. Keys: space pauses, n plays one value, + and - change the speed, the arrows go 5 s, q ends.

    Example: mkctl log play flight.mcap --from 60 --speed 4

    Args:
        file: The recording.
        speed: Seconds of the recording a second.
        start: Begin there: seconds from the beginning, negative from the end, or a time in ISO 8601.
        end: End there, given likewise.
        loop: Begin again at the end.
        step: Begin paused; n plays one value.
        key: Only these keys, for example `-k 'state/*'`.
        name: Vehicle to play as.
        listen: Zenoh endpoint for clients, for example tcp/127.0.0.1:7448; without it they meet at that of --connect.
        wait: Longest wait for a client that subscribes or queries [s]; 0 for none.

    Raises:
        MkError: the recording cannot be read, nothing of it is left to play, or a daemon has this name.
        ConfigError: a time, name, speed or endpoint cannot be understood.
    """
    from mkdaemon.client.player import Player, PlayPace, open_player_session
    from mkdaemon.client.playselection import PlaySelection, RecordedSamples

    if name is not None:
        require_vehicle_name(name, "--as")
    part = RecordedSamples(file, key, moment_of(start, file, "--from"), moment_of(end, file, "--to"))
    with reading_progress([file]) as progress:
        selection = PlaySelection.of(part, name, progress)
    where = () if listen else (connection.connect,)
    async with open_player_session(connect=where, listen=listen, zenoh_file=connection.zenoh_file) as session:
        player = Player(session, selection, PlayPace(speed, selection.first, monotonic(), is_paused=step), file.name)
        await player.refuse_live_daemons()
        favour_threads()
        with player.answering():
            async with showing_player(player, quiet=connection.json):
                if wait > 0:
                    await _wait(player, wait)
                await player.play(loops=loop)
    return _print_result(player, as_json=connection.json)


async def _wait(player: Player, seconds: float) -> None:
    """Wait for a client that subscribes or queries, and print that it waits.

    Raises:
        MkError: no client came.
    """
    print("waiting for a subscriber; q ends", file=sys.stderr)
    try:
        async with asyncio.timeout(seconds):
            await player.wait_for_subscribers()
    except TimeoutError:
        msg = f"no client subscribed within {seconds:g} s: start a viewer first, or wait longer (--wait; 0: no wait)"
        raise MkError(msg) from None


def _print_result(player: Player, *, as_json: bool) -> int:
    """Say what was put, beside what is in the file."""
    missing, sent = {} if player.was_sought else player.missing, player.sent.total
    late = player.sent.late_below(0.99)
    verdict = "as many as in the file" if not missing else f"{sum(missing.values())} of the file were not put"
    if player.was_sought:
        verdict = "not compared with the file, as it was moved to other places"
    words = f"{sent} values of {len(player.sent.counts)} keys put: {verdict}"
    words += "" if late is None else f"\nlate p99: {late * 1e3:.2f} ms"
    found = {"sent": sent, "missing": missing, "late_p99_s": late, **picked(player, "rounds", "was_sought")}
    show(found, words, as_json=as_json)
    return EXIT_OK if not missing else EXIT_FAILURE


DRAW: Final = 0.1
"""Time between two pictures of the bar [s]."""
FACTOR: Final = 2.0
"""Of the speed, with one key."""
LEGEND: Final = "space pause, n step, ←→ 5 s, + faster, - slower, q end"
LEAP: Final = 5.0
"""With an arrow key [s]."""


def key_pressed(player: Player, key: str) -> None:
    """Do what a key asks for; others are ignored.

    Args:
        player: what plays.
        key: as `KeyReader` has it.
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
        case "left" | "right":
            player.seek(player.status().place + (LEAP if key == "right" else -LEAP))
        case "q":
            player.stop()
        case _:
            return


@asynccontextmanager
async def showing_player(player: Player, *, quiet: bool) -> AsyncIterator[None]:
    """Show a bar and take keys while the context lasts; nothing when `quiet` or no terminal is there."""
    from rich.progress import BarColumn, Progress, TextColumn

    from mkdaemon.cli.console import Console

    console = Console(stderr=True)
    is_shown = not quiet and console.is_terminal
    columns = (BarColumn(), TextColumn("{task.description}"), TextColumn(LEGEND, style="dim"))
    takes_keys = is_shown and sys.stdin.isatty()
    keys = taking_keys(sys.stdin.fileno(), partial(key_pressed, player)) if takes_keys else nullcontext()
    with Progress(*columns, console=console, transient=True, disable=not is_shown) as bars, keys:
        async with background(_draw(player, bars.update, bars.add_task("", total=None))):
            yield


async def _draw(player: Player, update: Callable[..., None], task: object) -> None:
    while True:
        status = player.status()
        text = f"{status.place:.1f} of {status.length:.1f} s, {status.speed:g} times, {status.sent} values"
        text += f", {status.state}" if status.state is not PlayState.PLAYING else ""
        update(task, total=status.length or 1.0, completed=status.place, description=text)
        await asyncio.sleep(DRAW)

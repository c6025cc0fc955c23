"""`mkctl view`: the aircraft in a browser, live or from a recording."""

from __future__ import annotations

import asyncio
import sys
import time
import webbrowser
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from mkdaemon.cli.arguments import Length, Port
from mkdaemon.cli.interrupts import until_asked_to_end
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.log import reading_progress
from mkdaemon.cli.promptness import favour_threads
from mkdaemon.client import Vehicle

PORT: Final = 8747


async def view(
    file: Path | None = None,
    /,
    *,
    port: Port = PORT,
    no_browser: bool = False,
    speed: Annotated[Length, Parameter(name=["--speed", "-s"])] = 1.0,
    paused: bool = False,
    loop: bool = False,
    connection: Connection = HERE,
) -> None:
    """Show the aircraft in a browser: where it is, what its cameras see, its holder, link, battery and events.

    The page is served at 127.0.0.1 only, needs no network, and shows every vehicle and every recording that is played
    at the daemon's endpoint. Given a file, it shows that recording, and needs no daemon. Ctrl-C ends it. Two buttons
    command, each after a question: abort and release.

    Example: mkctl view flight.mcap --speed 2

    Args:
        file: A recording to show.
        port: Of the page; 0 for any that is free.
        no_browser: Only print the address.
        speed: With a file: seconds of the recording a second.
        paused: With a file: begin paused.
        loop: With a file: begin again at the end.
        connection: Which vehicle is shown first, and where its daemon is.

    Raises:
        MkError: no daemon at the endpoint, or the recording cannot be read.
        ConfigError: the port is in use, or a number cannot be.
    """
    from mkdaemon.view.page.viewer import serving

    favour_threads()
    opening = connection.open() if file is None else _played(file, speed, is_paused=paused, loops=loop)
    async with opening as uav, serving(uav, port) as address:
        connection.show({"address": address}, f"the page is at {address}; Ctrl-C ends it")
        sys.stdout.flush()
        if not no_browser:
            await asyncio.to_thread(webbrowser.open, address)
        await until_asked_to_end()


@asynccontextmanager
async def _played(file: Path, speed: float, *, is_paused: bool, loops: bool) -> AsyncIterator[Vehicle]:
    """Play a recording in this process, on a separate bus; yield a client of it."""
    from mkdaemon.client.player import Player, PlayPace, open_player_session
    from mkdaemon.client.playselection import PlaySelection, RecordedSamples

    with reading_progress([file]) as progress:
        selection = await asyncio.to_thread(PlaySelection.of, RecordedSamples(file), None, progress)
    async with open_player_session(connect=(), listen=None, alone=True) as session:
        player = Player(
            session, selection, PlayPace(speed, selection.first, time.monotonic(), is_paused=is_paused), file.name
        )
        with player.answering():
            playing = asyncio.create_task(player.play(loops=loops, stays=True), name="player")
            try:
                yield Vehicle(session, min(selection.names), "this recording")
            finally:
                player.stop()
                await asyncio.gather(playing, return_exceptions=True)

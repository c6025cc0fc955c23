"""The program that shows a row for each vehicle. Needs textual, the extra `top`."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, ClassVar

from textual import work
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from mkdaemon.client.fleet import Fleet
from mkdaemon.errors import MkError
from mkdaemon.view.top.fleetboard import KEYS, FleetBoard
from mkdaemon.view.top.terminalapp import REDRAW, RETRY, letters

if TYPE_CHECKING:
    from mkdaemon.client import Vehicle


class FleetApp(App[None]):
    """Shows every vehicle of an endpoint; changes nothing."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("q", "quit", "quit")]
    CSS = "#all { width: 80; height: auto; }"
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, connect: Callable[[], AbstractAsyncContextManager[Vehicle]]) -> None:
        """Show them.

        Args:
            connect: any client of the endpoint.
        """
        super().__init__()
        self.board = FleetBoard()
        self._connect = connect

    def compose(self) -> ComposeResult:
        """One picture of letters, as high as it must be."""
        with VerticalScroll():
            yield Static(id="all")

    def on_mount(self) -> None:
        """Begin."""
        self.set_interval(REDRAW, self.draw)
        self.watch_fleet()

    def draw(self) -> None:
        """Draw what is known now."""
        self.query_one("#all", Static).update(letters(self.board.rows(time.monotonic(), time.time())))

    @work
    async def watch_fleet(self) -> None:
        """Watch every vehicle, for ever; an endpoint that does not answer is tried again."""
        while True:
            try:
                async with self._connect() as any_client:
                    self.board.notice = ""
                    await watch_vehicles(any_client, self.board)
            except MkError as error:
                self.board.notice = str(error)
            await asyncio.sleep(RETRY)


async def watch_vehicles(client: Vehicle, board: FleetBoard) -> None:
    """Keep a board up to date with every vehicle at an endpoint, for ever."""
    fleet = Fleet(client)

    def changed() -> None:
        board.look(fleet.vehicles, time.monotonic())

    async with fleet.watch(changed, lambda *_: None), fleet.values(*KEYS) as samples:
        async for sample in samples:
            name, _, suffix = sample.suffix.partition("/")
            board.take(name, suffix, sample.known, time.monotonic())

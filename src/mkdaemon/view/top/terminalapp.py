"""The programs that show a vehicle, asking before they act, or a row for each. Needs textual, the extra `top`."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, ClassVar, Final

from rich.text import Text
from textual import work
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import OptionList, Static

from mkdaemon.client.fleet import Fleet
from mkdaemon.errors import MkError
from mkdaemon.spelling import on_one_line
from mkdaemon.view.top.fleetboard import KEYS as FLEET_KEYS
from mkdaemon.view.top.fleetboard import FleetBoard
from mkdaemon.view.top.panels import KEYS, Row, VehicleBoard

if TYPE_CHECKING:
    from mkdaemon.client import Vehicle

REDRAW: Final = 0.25
"""Between two drawings [s]: little enough for a slow ssh line."""
FLEET_EVERY: Final = 3.0
"""Between two looks for other vehicles [s]."""
RETRY: Final = 2.0
"""Before a daemon that was not there is looked for again [s]."""

OpenVehicle = Callable[[str], AbstractAsyncContextManager["Vehicle"]]
Act = Callable[[str], Awaitable[str]]
"""Does something with a vehicle and returns what came of it, in words."""


class QuestionScreen(ModalScreen[bool]):
    """Asks before something happens; only `y` says yes."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer(True)", "yes"),
        Binding("n,escape,q", "answer(False)", "no"),
    ]
    CSS = """
    QuestionScreen { align: center middle; }
    #question { width: 66; height: auto; padding: 1 2; border: heavy $warning; background: $surface; }
    """

    def __init__(self, words: str) -> None:
        super().__init__()
        self._words = words

    def compose(self) -> ComposeResult:
        """The words, and the two keys."""
        with Vertical(id="question"):
            yield Static(Text(f"{on_one_line(self._words)}\n\ny yes      n no"))

    def action_answer(self, is_wanted: bool) -> None:
        """Return the answer."""
        self.dismiss(is_wanted)


class Choice(ModalScreen[str | None]):
    """Shows the fleet; Enter chooses."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,q", "leave", "back")]
    CSS = """
    Choice { align: center middle; }
    #fleet { width: 40; height: auto; max-height: 16; border: heavy $accent; }
    """

    def __init__(self, fleet: list[str]) -> None:
        super().__init__()
        self._fleet = fleet

    def compose(self) -> ComposeResult:
        """The names."""
        yield OptionList(*(Text(on_one_line(name)) for name in self._fleet), id="fleet")

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Return the name."""
        self.dismiss(self._fleet[event.option_index])

    def action_leave(self) -> None:
        """Return nothing."""
        self.dismiss(None)


class TopApp(App[None]):
    """Shows one vehicle of a fleet."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "leave", "quit"),
        Binding("r", "release", "release"),
        Binding("l", "land", "land"),
        Binding("v", "choose", "vehicle"),
    ]
    CSS = "#all { width: 80; height: 24; }"
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, vehicle: str, open_vehicle: OpenVehicle, *, release: Act, land: Act) -> None:
        """Show a vehicle.

        Args:
            vehicle: its name.
            open_vehicle: connects to one of a name.
            release: releases one.
            land: lands one; if cancelled, releases it.
        """
        super().__init__()
        self.board = VehicleBoard(vehicle)
        self._open = open_vehicle
        self._release, self._land = release, land
        self._landing: asyncio.Task[None] | None = None

    def compose(self) -> ComposeResult:
        """One picture of letters."""
        yield Static(id="all")

    def on_mount(self) -> None:
        """Begin."""
        self.set_interval(REDRAW, self.draw)
        self.watch_vehicle()

    def draw(self) -> None:
        """Draw what is known now."""
        self.screen_stack[0].query_one("#all", Static).update(letters(self.board.rows(time.monotonic())))

    @work(exclusive=True, group="watch")
    async def watch_vehicle(self) -> None:
        """Watch the chosen vehicle, for ever; a daemon that is not there is waited for."""
        board = self.board
        while True:
            try:
                async with self._open(board.vehicle) as uav, asyncio.TaskGroup() as tasks:
                    tasks.create_task(_watch(uav, board))
                    tasks.create_task(_look_for_others(uav, board))
            except* MkError as errors:
                board.notice = str(errors.exceptions[0])
            await asyncio.sleep(RETRY)

    def action_release(self) -> None:
        """Ask, then release the aircraft."""
        words = f"Release {self.board.vehicle} now? Its client loses it; the pilot's sticks rule at once."
        self._ask(words, lambda: self._act("release", self._release))

    def action_land(self) -> None:
        """Ask, then land on the target in sight."""
        if self._landing is not None and not self._landing.done():
            self.board.notice = "it lands already"
            return
        holder = self.board.lease_holder()
        taken = f" This takes the lease from {holder}." if holder else ""
        words = (
            f"Land {self.board.vehicle} on the target in sight?{taken} Stay here until it stands: leaving releases it."
        )
        self._ask(words, self._begin_landing)

    def _begin_landing(self) -> None:
        self._landing = asyncio.create_task(self._perform("land", self._land, self.board), name="landing")

    def action_choose(self) -> None:
        """Choose another vehicle."""
        fleet = sorted({*self.board.fleet, self.board.vehicle})
        self.push_screen(Choice(fleet), self._show_other)

    def _show_other(self, name: str | None) -> None:
        if name is None or name == self.board.vehicle:
            return
        fleet = self.board.fleet
        self.board = VehicleBoard(name)
        self.board.fleet = fleet
        self.watch_vehicle()

    def action_leave(self) -> None:
        """End; while it lands, only after a question."""
        if self._landing is not None and not self._landing.done():
            self._ask("It is landing. Leave, and release the aircraft in the air?", self.exit)
        else:
            self.exit()

    async def on_unmount(self) -> None:
        """A landing that goes on is given up: its lease is given back, which releases the aircraft."""
        if self._landing is not None:
            self._landing.cancel()
            await asyncio.gather(self._landing, return_exceptions=True)

    def _ask(self, words: str, act: Callable[[], object]) -> None:
        def answered(is_wanted: bool | None) -> None:
            if is_wanted:
                act()

        self.push_screen(QuestionScreen(words), answered)

    def _act(self, name: str, act: Act) -> None:
        self.run_worker(self._perform(name, act, self.board), group=name)

    async def _perform(self, name: str, act: Act, board: VehicleBoard) -> None:
        board.notice = f"{name} ..."
        try:
            board.notice = await act(board.vehicle)
        except MkError as error:
            board.notice = f"{name}: {error}"


async def _watch(uav: Vehicle, board: VehicleBoard) -> None:
    async with uav.watch(*KEYS, are_known=True) as samples:
        for pattern in KEYS:
            for suffix, sample in sorted((await uav.get_all(pattern)).items()):
                board.take(suffix, sample.known, time.monotonic() - (sample.age or 0.0))
        board.notice = await uav.absence() or ""
        async for sample in samples:
            board.take(sample.suffix, sample.known, time.monotonic())


async def _look_for_others(uav: Vehicle, board: VehicleBoard) -> None:
    while True:
        board.fleet = await uav.vehicles()
        await asyncio.sleep(FLEET_EVERY)


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

    async with fleet.watch(changed, lambda *_: None), fleet.values(*FLEET_KEYS) as samples:
        async for sample in samples:
            name, _, suffix = sample.suffix.partition("/")
            board.take(name, suffix, sample.known, time.monotonic())


def letters(rows: Sequence[Row]) -> Text:
    """Rows as textual shows them."""
    lines = (Text.assemble(*((text, str(tone)) for text, tone in row), no_wrap=True) for row in rows)
    return Text("\n").join(lines)

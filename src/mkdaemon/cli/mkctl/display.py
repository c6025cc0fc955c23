"""`mkctl board display`: a board's own 4x20 menu, live, with keys."""

from __future__ import annotations

import asyncio
import sys
from contextlib import suppress
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.keyreader import QUIT, taking_keys
from mkdaemon.cli.mkctl.board_request import find_board
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.client import Vehicle
from mkdaemon.client.taskerrors import beside
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.protocol.flags import MenuKey
from mkdaemon.protocol.messages import ALL_KEYS_UP, Display, DisplayRequest
from mkdaemon.protocol.wire import Board

LINES, COLUMNS = 4, 20
INTERVAL: Final = 25
"""Interval between two pictures while no key is pressed [10 ms]."""
RENEW: Final = 2.0
"""Between two renewals [s]; a stream ends 4 s after the last."""
KEYS: Final = {
    "left": MenuKey.PREVIOUS_PAGE,
    "right": MenuKey.NEXT_PAGE,
    "p": MenuKey.PREVIOUS_PAGE,
    "n": MenuKey.NEXT_PAGE,
    "0": MenuKey.PREVIOUS_PAGE | MenuKey.NEXT_PAGE,
    "3": MenuKey.KEY_3,
    "up": MenuKey.KEY_3,
    "4": MenuKey.KEY_4,
    "down": MenuKey.KEY_4,
}
"""What is typed, and the keys of the menu it presses."""
LEGEND: Final = "left/right page, 0 first page, 3 and 4 keys of the page, q leaves"


async def display(
    board: Annotated[
        Literal["fc", "nc"] | None, Parameter(help="Board of the menu; default: the board at the end of the wire.")
    ] = None,
    /,
    *,
    once: Annotated[bool, Parameter(help="Print one picture and exit.")] = False,
    keys: Annotated[bool, Parameter(help="Allow keys 3 and 4, which can change trim or calibration.")] = False,
    connection: Connection = HERE,
) -> None:
    """Show a board's menu and press its keys.

    Without a terminal, or with --once, one picture is printed.

    Example: mkctl board display fc --once
    """
    async with connection.open() as client:
        asked = Board[board.upper()] if board else await find_board(client, DisplayRequest.spec.boards)
        if once or connection.json or not (sys.stdin.isatty() and sys.stdout.isatty()):
            picture = await _press(client, asked, MenuKey.NONE, 0)
            connection.show({"lines": lines_of(picture)}, "\n".join(lines_of(picture)))
            return
        typed: asyncio.Queue[str] = asyncio.Queue()
        with taking_keys(sys.stdin.fileno(), typed.put_nowait):
            await _live(client, asked, typed, allow_change=keys)


def lines_of(text: str) -> list[str]:
    """Cut a picture into its four lines; characters a terminal would act on become blanks."""
    clean = "".join(letter if letter.isprintable() else " " for letter in text).ljust(LINES * COLUMNS)
    return [clean[at : at + COLUMNS] for at in range(0, LINES * COLUMNS, COLUMNS)]


async def _press(client: Vehicle, board: Board, keys: MenuKey, interval: int) -> str:
    message = DisplayRequest(keys_inverted=ALL_KEYS_UP & ~int(keys), interval=interval)
    return (await client.request(board, message, Display)).text


async def _live(client: Vehicle, board: Board, typed: asyncio.Queue[str], *, allow_change: bool) -> None:
    """Draw what comes, and renew the stream; keys go out as they are typed."""
    from rich import box
    from rich.console import Group
    from rich.live import Live
    from rich.panel import Panel
    from rich.text import Text

    from mkdaemon.cli.console import Console

    picture = await _press(client, board, MenuKey.NONE, INTERVAL)
    with Live(console=Console(), screen=True, auto_refresh=False) as live:

        def show(text: str | None = None, note: str = "") -> None:
            nonlocal picture
            picture = picture if text is None else text
            framed = Panel(Text("\n".join(lines_of(picture))), box.ASCII, expand=False, padding=0)
            live.update(Group(framed, Text(LEGEND), Text(note)), refresh=True)

        async def press(keys: MenuKey) -> None:
            try:
                show(await _press(client, board, keys, INTERVAL))
            except CommandRejectedError as error:
                show(note=str(error))

        async def renew() -> None:
            while True:
                await asyncio.sleep(RENEW)
                await press(MenuKey.NONE)

        async def draw() -> None:
            async for frame in client.rx(board.word, "display")():
                show(frame.fields.text)

        show()
        try:
            async with beside(renew(), draw()):
                while (word := await typed.get()) not in QUIT:
                    key = KEYS.get(word, MenuKey.NONE)
                    if key & (MenuKey.KEY_3 | MenuKey.KEY_4) and not allow_change:
                        show(note="3 and 4 may change trim or calibration: start again with --keys")
                    elif key:
                        await press(key)
        finally:
            with suppress(MkError):
                await client.request(board, DisplayRequest(interval=0))

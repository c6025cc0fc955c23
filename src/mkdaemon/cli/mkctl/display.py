"""`mkctl board display`: a board's own 4x20 menu, live, with keys."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Sequence
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.keyreader import QUIT, taking_keys
from mkdaemon.cli.mkctl.board_request import try_request
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.terminal import drawing_stream, on_one_line
from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError, RequestTimeoutError
from mkdaemon.protocol.flags import MenuKey
from mkdaemon.protocol.messages import ALL_KEYS_UP, Display, DisplayRequest
from mkdaemon.protocol.wire import Board

LINES, COLUMNS = 4, 20
INTERVAL: Final = 25
"""Interval between two pictures while no key is pressed [10 ms]."""
MEETING: Final = 5.0
"""Longest wait for the daemon to know who is on the line [s]; it takes about one."""
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
        asked = Board[board.upper()] if board else await _board_here(client)
        if once or connection.json or not (sys.stdin.isatty() and sys.stdout.isatty()):
            picture = await _press(client, asked, MenuKey.NONE, 0)
            connection.show({"lines": lines_of(picture)}, "\n".join(lines_of(picture)))
            return
        typed: asyncio.Queue[str] = asyncio.Queue()
        with taking_keys(sys.stdin.fileno(), typed.put_nowait):
            await _live(client, asked, typed, allow_change=keys)


async def _board_here(client: Vehicle) -> Board:
    """The board the wire ends at: the NaviCtrl where there is one. Waits a while for boards to be met."""
    boards: Sequence[str] = ()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(MEETING):
            while not boards:
                sample = await client.get("link/state")
                boards = sample.fields.get("boards", ()) if sample else ("nc",)
                await asyncio.sleep(0 if boards else 0.2)
    return Board.FC if boards == ["fc"] else Board.NC


def lines_of(text: str) -> list[str]:
    """Cut a picture into its four lines; characters a terminal would act on become blanks."""
    clean = "".join(letter if letter.isprintable() else " " for letter in text).ljust(LINES * COLUMNS)
    return [clean[at : at + COLUMNS] for at in range(0, LINES * COLUMNS, COLUMNS)]


def frame_of(text: str) -> str:
    """Return a picture with a border, as lines for a raw terminal."""
    bar = "+" + "-" * COLUMNS + "+"
    return "\r\n".join([bar, *(f"|{on_one_line(line)}|" for line in lines_of(text)), bar])


async def _press(client: Vehicle, board: Board, keys: MenuKey, interval: int) -> str:
    message = DisplayRequest(keys_inverted=ALL_KEYS_UP & ~int(keys), interval=interval)
    answer = await try_request(client, board, message)
    if not isinstance(answer, Display):
        raise RequestTimeoutError(f"the {board.word.upper()} sends no menu; check `mkctl status`")
    return answer.text


async def _live(client: Vehicle, board: Board, typed: asyncio.Queue[str], *, allow_change: bool) -> None:
    """Draw what comes, and renew the stream; keys go out as they are typed."""
    drawing_stream(sys.stdout).write("\x1b[2J")
    _draw(await _press(client, board, MenuKey.NONE, INTERVAL))

    async def renew() -> None:
        while True:
            await asyncio.sleep(RENEW)
            with contextlib.suppress(RequestTimeoutError):
                await _press(client, board, MenuKey.NONE, INTERVAL)

    async def draw() -> None:
        async with client.watch(f"rx/{board.word}/display") as samples:
            async for sample in samples:
                fields = sample.fields.get("fields", sample.fields)
                _draw(str(fields.get("text", "")))

    tasks = [asyncio.create_task(job(), name=f"display {job.__name__}") for job in (renew, draw)]
    try:
        while (word := await typed.get()) not in QUIT:
            key = KEYS.get(word)
            _note("")
            if key is None:
                continue
            if key & (MenuKey.KEY_3 | MenuKey.KEY_4) and not allow_change:
                _note("3 and 4 may change trim or calibration: start again with --keys")
                continue
            with contextlib.suppress(RequestTimeoutError):
                _draw(await _press(client, board, key, INTERVAL))
    finally:
        for task in tasks:
            task.cancel()
        ended = await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(MkError):
            await try_request(client, board, DisplayRequest(interval=0))
    for result in ended:
        if isinstance(result, Exception) and not isinstance(result, asyncio.CancelledError):
            raise result


def _draw(text: str) -> None:
    """Draw at the top left, without clearing, so that nothing flickers."""
    _put(f"\x1b[H{frame_of(text)}\r\n{LEGEND}\x1b[K\r\n")


def _note(text: str) -> None:
    """Write the line below the legend; it stays until the next key."""
    _put(f"\x1b[{LINES + 4};1H{text}\x1b[K")


def _put(drawing: str) -> None:
    """Draw on the terminal."""
    stream = drawing_stream(sys.stdout)
    stream.write(drawing)
    stream.flush()

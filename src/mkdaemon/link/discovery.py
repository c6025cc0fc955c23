"""Who is on the line, directly or behind a NaviCtrl, without sending what could harm.

Only `v`, stream requests, the escape sequence and, with the motors known off, `u 0` are sent. `t` never is: at a
FlightCtrl the NaviCtrl's time request spins a motor (docs/protocol.md, "Same letter, different meaning").

1. `v` to any address. The address of the answer is the only proof of who is there.
2. No answer, or one from a FlightCtrl: another program may have left a NaviCtrl redirected. The escape sequence twice,
   50 ms apart, ends that; harmless to everybody else. Ask again.
3. A NaviCtrl answered and the FlightCtrl's release is unknown: once fresh telemetry says that the motors stand still,
   redirect (`u 0`), ask the FlightCtrl, escape. The NaviCtrl's port is blind for about 0.3 s meanwhile.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Final

from mkdaemon.errors import CommandRejectedError, LinkError
from mkdaemon.protocol.messages.navictrl import Redirect
from mkdaemon.protocol.messages.version import VersionRequest
from mkdaemon.protocol.wire import Board

if TYPE_CHECKING:
    from mkdaemon.link.link import Link

ESCAPE_PAUSE_S: Final = 0.05
"""Between the two escape sequences, and after them before the next frame [s]."""
SWITCH_S: Final = 0.03
"""A NaviCtrl takes this long to switch its port over [s]; 25 ms measured."""
MOTORS_WAIT_S: Final = 3.0
"""How long to wait for telemetry that tells whether the motors run [s]."""
ASK_AGAIN_S: Final = (0.1, 0.2, 0.4)
"""Pauses between rounds of questions while nobody answers; the last one repeats [s]."""


async def introduce(link: Link, *, probe_flightctrl: bool) -> None:
    """Find out who is there, ask for the streams, and look behind a NaviCtrl; ends when all that is known."""
    await _find_direct_board(link)
    link.begin_streams()
    if link.direct_board is not Board.NC or link.dialect.fc_release is not None or not probe_flightctrl:
        return
    if await motors_stand_still(link):
        await _look_behind(link)


async def _find_direct_board(link: Link) -> None:
    for round_number in range(1_000_000):
        if await _ask_version(link, Board.ANY) and link.direct_board is Board.NC:
            return
        await link.send_escape()
        await asyncio.sleep(ESCAPE_PAUSE_S)
        await link.send_escape()
        await asyncio.sleep(ESCAPE_PAUSE_S)
        if await _ask_version(link, Board.ANY):
            return
        await asyncio.sleep(ASK_AGAIN_S[min(round_number, len(ASK_AGAIN_S) - 1)])


async def _ask_version(link: Link, board: Board) -> bool:
    try:
        await link.request(VersionRequest(), board=board, timeout=0.15, retries=0)
    except (LinkError, CommandRejectedError):
        return False
    return True


async def motors_stand_still(link: Link) -> bool:
    """Wait a while for telemetry to say that they do; whether it did."""
    try:
        async with asyncio.timeout(MOTORS_WAIT_S):
            while not link.motors_known_off():  # noqa: ASYNC110 - telemetry is a state, not an event
                await asyncio.sleep(0.05)
    except TimeoutError:
        return False
    return True


async def _look_behind(link: Link) -> None:
    async with redirected(link, Board.FC):
        for _ in range(3):
            if await _ask_version(link, Board.FC):
                # Through a NaviCtrl 0.24 no release is ever confirmed; here one is.
                await link.release("FlightCtrl found")
                break


@asynccontextmanager
async def redirected(link: Link, board: Board) -> AsyncIterator[None]:
    """Have a NaviCtrl pass the line through to another board; the escape sequence ends it, whatever happens.

    Raises:
        CommandRejectedError: no NaviCtrl is on the line, or its telemetry does not say that the motors stand still
            (a redirection stops its servos and its telemetry).
    """
    ports = {Board.FC: 0, Board.MAG: 1}
    if link.direct_board is not Board.NC or board not in ports:
        raise CommandRejectedError(
            "not_redirectable", f"The line cannot be passed through to {board.word}.", "Connect to that board directly."
        )
    if not link.motors_known_off():
        raise CommandRejectedError(
            "motors_not_known_off",
            "A redirection stops the NaviCtrl's telemetry and servos.",
            "Stop the motors and wait for telemetry that says so.",
        )
    await link.send(Redirect(port=ports[board]), board=Board.NC)
    link.note_redirect(board)
    try:
        await asyncio.sleep(SWITCH_S)
        yield
    finally:
        for _ in range(2):
            await link.send_escape()
            await asyncio.sleep(ESCAPE_PAUSE_S)
        link.note_redirect(None)

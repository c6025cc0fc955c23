"""Identifies the boards on the line, directly or behind a NaviCtrl, by harmless requests.

Only `v`, stream requests, the escape sequence and, with the motors known off, `u 0` are sent. `t` never is: at a
FlightCtrl the NaviCtrl's time request spins a motor (docs/protocol.md, "Same letter, different meaning").

1. `v` to any address. Only the address of the answer proves which board is there.
2. No answer, or one from a FlightCtrl: another program may have left a NaviCtrl redirected. The escape sequence twice,
   50 ms apart, ends that, and does not disturb other boards. Ask again.
3. A NaviCtrl answered and the FlightCtrl's release is unknown: once fresh telemetry says that the motors stand still,
   redirect (`u 0`), ask the FlightCtrl, escape. The NaviCtrl's port is blind for about 0.3 s meanwhile. Motors that
   run are waited for; a FlightCtrl that does not answer is looked for again, ever more seldom, and then no more.
4. `u 0` stops the timer of the NaviCtrl's camera servos, and the escape starts it again only after `u 1` or `u 2`: each
   redirection to the FlightCtrl ends with `u 1` and another escape. Source: docs/firmware-notes, "Sending".
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from itertools import chain, repeat
from typing import Final

from mkdaemon.errors import CommandRejectedError, LinkError, RequestTimeoutError
from mkdaemon.link.link import Link
from mkdaemon.protocol.flags import RedirectPort
from mkdaemon.protocol.messages.navictrl import Redirect
from mkdaemon.protocol.messages.version import VersionRequest
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token, refuse

ESCAPE_PAUSE: Final = 0.05
"""Between the two escape sequences, and after them before the next frame [s]."""
SWITCH_TIME: Final = 0.03
"""A NaviCtrl takes this long to switch its port over [s]; 25 ms measured."""
MOTORS_WAIT: Final = 3.0
"""How long to wait for telemetry that tells whether the motors run [s]."""
ASK_AGAIN: Final = (0.1, 0.2, 0.4)
"""Pauses between rounds of questions without an answer; the last one repeats [s]."""
LOOK_AGAIN: Final = (1.0, 4.0, 15.0, 60.0)
"""Pauses between looks behind a NaviCtrl while its FlightCtrl is unknown; the last one repeats [s]. Each costs 0.6 s
of telemetry; their number is `link.flightctrl_looks`."""
STILL: Final = 0.3
"""A NaviCtrl that passes the line through is silent for this long after three questions of 0.15 s [s]."""
DISCOVERY_TIME: Final = 4.0
"""Longest wait of a request for the identification of the boards [s]; a start takes 0.5-1.5 s."""


async def discover(link: Link) -> None:
    """Identify the boards after the opening, and after every silence long enough for a reboot; runs for ever."""
    while True:
        await link.needs_discovery.wait()
        link.needs_discovery.clear()
        await discover_boards(link)
        await discover_flightctrl(link, until=link.needs_discovery)


async def discover_boards(link: Link) -> None:
    """Identify the boards on the line, and ask for the streams."""
    await _find_direct_board(link)
    link.start_streams()


async def discover_flightctrl(link: Link, *, until: asyncio.Event) -> None:
    """Ask the FlightCtrl behind a NaviCtrl for its release, ever more seldom; ends when it is known or never answers.

    Args:
        link: its boards are discovered.
        until: ends it, too: the boards must be identified again.
    """
    pauses = chain(LOOK_AGAIN, repeat(LOOK_AGAIN[-1]))
    while link.lacks_flightctrl and not until.is_set():
        pause = LOOK_AGAIN[0]  # waiting for motors that stand still costs nothing and has no end
        with suppress(CommandRejectedError, RequestTimeoutError):
            if await _ask_flightctrl(link):
                link.count_look()
                pause = next(pauses)
        if link.lacks_flightctrl:
            with suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await until.wait()


async def wait_for_discovery(link: Link) -> bool:
    """Wait a while for the boards on the line to name their releases; returns whether they have.

    Ends early where a FlightCtrl that cannot be asked is remembered.
    """
    with suppress(TimeoutError):
        async with asyncio.timeout(DISCOVERY_TIME):
            while link.is_discovering and link.offered_memory() is None:  # noqa: ASYNC110 - what is known is a state, not an event
                await asyncio.sleep(0.05)
    return not link.is_discovering


async def _ask_flightctrl(link: Link) -> bool:
    """Look behind the NaviCtrl; returns whether that was a look: a NaviCtrl that talks on has not passed the line on.

    Through a NaviCtrl 0.24 no release is ever confirmed; while the line is passed through one is.
    """
    async with redirection(link, Board.FC):
        for _ in range(3):
            if await _ask_version(link, Board.FC):
                await link.release("FlightCtrl found")
                return True
        return link.heard_age > STILL


async def _find_direct_board(link: Link) -> None:
    pauses = chain(ASK_AGAIN, repeat(ASK_AGAIN[-1]))
    while True:
        if await _ask_version(link, Board.ANY) and link.is_proven(Board.NC):
            return
        await link.send_escape()
        await asyncio.sleep(ESCAPE_PAUSE)
        await link.send_escape()
        await asyncio.sleep(ESCAPE_PAUSE)
        if await _ask_version(link, Board.ANY):
            return
        await asyncio.sleep(next(pauses))


async def _ask_version(link: Link, board: Board) -> bool:
    try:
        await link.request(VersionRequest(), board=board, timeout=0.15, retries=0)
    except (LinkError, CommandRejectedError):
        return False
    return True


async def wait_for_still_motors(link: Link) -> bool:
    """Wait a while for telemetry that says whether the motors run; returns whether they stand still."""
    with suppress(TimeoutError):
        async with asyncio.timeout(MOTORS_WAIT):
            while link.motors_running() is None:  # noqa: ASYNC110 - telemetry is a state, not an event
                await asyncio.sleep(0.05)
    return link.motors_running() is False


PORTS: Final = {RedirectPort.FC: Board.FC, RedirectPort.MAG: Board.MAG, RedirectPort.GPS: Board.ANY}
"""The board at the other end of a redirected line; a GPS receiver has no address and only sends."""


@asynccontextmanager
async def redirection(link: Link, board: Board, admit: Callable[[], None] = lambda: None) -> AsyncIterator[None]:
    """Have a NaviCtrl pass the line through to another board; the escape sequence ends it, whatever happens.

    `Board.ANY` is the GPS receiver: nothing is sent to it, what it says is raw bytes.

    One at a time: the next one waits for its turn, and then for telemetry, which stopped meanwhile, to tell about the
    motors again.

    Args:
        link: the line.
        board: the wanted board.
        admit: raises `CommandRejectedError` where the line must not be passed through any more; asked right before.

    Raises:
        CommandRejectedError: no NaviCtrl is on the line, the line is silent, or telemetry does not say that the motors
            stand still (a redirection stops the NaviCtrl's servos and its telemetry).
    """
    ports = {end: port for port, end in PORTS.items()}
    if link.direct_board is not Board.NC or board not in ports:
        raise refuse(Token.NOT_REDIRECTABLE, board=board.word)
    async with link.passage:
        if not await wait_for_still_motors(link):
            state = link.health().state
            if not state.condition.is_usable and link.motors_running() is None:
                raise refuse(Token.LINK_DOWN, state=state.condition.value, detail=state.reason)
            raise refuse(Token.MOTORS_NOT_KNOWN_OFF)
        admit()
        await link.send(Redirect(port=ports[board]), board=Board.NC)
        link.set_redirection(board)
        try:
            await asyncio.sleep(SWITCH_TIME)
            yield
        finally:
            await _end_redirection(link)
            if board is Board.FC:
                await _restart_servos(link)


async def _end_redirection(link: Link) -> None:
    for _ in range(2):
        await link.send_escape()
        await asyncio.sleep(ESCAPE_PAUSE)
    link.set_redirection(None)


async def _restart_servos(link: Link) -> None:
    """Have the NaviCtrl set up the timer of its camera servos again; a release must not be lost to the compass."""
    for _ in range(50):
        if not link.is_releasing:
            break
        await asyncio.sleep(0.01)
    with suppress(CommandRejectedError, LinkError):
        await link.send(Redirect(port=RedirectPort.MAG), board=Board.NC)
        link.set_redirection(Board.MAG)
        try:
            await asyncio.sleep(SWITCH_TIME)
        finally:
            await _end_redirection(link)

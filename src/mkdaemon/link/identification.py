"""Keeps the link from writing to another aircraft at a port that was lost and came back.

What is asked and compared is `session.knownaircraft`; here are the port and the waiting.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from mkdaemon.clock import Clock
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.link.ports.port import Port, parse_address
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.link.session.exchange import Exchange
from mkdaemon.link.session.knownaircraft import IdentityCheck
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.boards import board_at
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Token, refuse

LOOK: Final = 0.5
"""Longest wait between two looks at what a client says, and at the device [s]."""
UNANSWERED: Final = 0.3
"""After this time without an answer the link reports what it waits for [s]."""
MOST_KEPT: Final = 4096
"""More is thrown away while no board answers [bytes]."""


class Identification:
    """Proves which aircraft is at a port that came back.

    Attributes:
        doubt: why nothing but questions is written; None while the aircraft is known, or the first one.
        is_other: another aircraft was found, and no client has accepted it.
    """

    def __init__(
        self,
        dialogue: Dialogue,
        exchange: Exchange,
        clock: Clock,
        motors_running: Callable[[float, float], bool | None],
    ) -> None:
        self._dialogue, self._exchange, self._clock = dialogue, exchange, clock
        self._motors_running = motors_running
        self._is_lost = False
        self._is_accepted = False
        self.doubt: CommandRejectedError | None = None
        self.is_other = False

    def port_lost(self) -> None:
        """Expect that the port may return with another aircraft."""
        self._is_lost = True
        self.doubt = None

    def port_ended(self, name: str) -> None:
        """The port was used until now; a search for the line rate closes it itself and opens it at once."""
        if self._dialogue.difference:
            self._find_other(name, self._dialogue.difference)
        elif self._exchange.bauds.attempt is None:
            self.port_lost()

    def accept(self) -> None:
        """A client says that the aircraft at the port is the right one.

        Raises:
            CommandRejectedError: `no_other_aircraft`: nothing is in doubt.
        """
        if self.doubt is None:
            raise refuse(Token.NO_OTHER_AIRCRAFT)
        self._is_accepted = True

    async def prove(self, port: Port) -> bytes | None:
        """Ask for the aircraft's identity until it is proven; return what arrived meanwhile, None for another aircraft.

        The first aircraft, a recording, and a port that a search for the line rate closed need no proof.

        Raises:
            LinkLostError: the port was lost.
        """
        known = self._dialogue.known
        if not self._is_lost or port.is_recording or not known.versions:
            return b""
        self._exchange.bauds.end_search()
        now = self._clock.now()
        still = self._motors_running(now, math.inf) is False
        check = IdentityCheck(known, self._dialogue.dialect.dead_man, now, may_read_set=still)
        arrived = await self._ask(port, check, now)
        if check.difference:
            self._find_other(port.name, check.difference)
            return None
        self.doubt, self._is_lost = None, False
        return arrived

    async def wait_for_change(self, url: str) -> None:
        """Wait until a client accepts the aircraft, or another device has the address."""
        seen = _device(url)
        while not self._is_accepted and _device(url) == seen:  # noqa: ASYNC110 - a file has no event
            await asyncio.sleep(LOOK)
        if self._is_accepted:
            self._dialogue.known.forget()
        self._is_accepted = self.is_other = False
        self.doubt = None

    def _find_other(self, name: str, difference: str) -> None:
        self.is_other = self._is_lost = True
        detail = f"another aircraft; the daemon writes nothing to it: {difference}"
        self._publish(refuse(Token.OTHER_AIRCRAFT, port=name, detail=detail))

    def _publish(self, doubt: CommandRejectedError) -> None:
        self.doubt = doubt
        self._exchange.port_lost(f"{doubt.reason} {doubt.fix}", LinkCondition.DOWN)

    async def _ask(self, port: Port, check: IdentityCheck, began: float) -> bytes:
        decoder, messages, arrived = FrameDecoder(), MessageDecoder(), bytearray()
        while not check.is_same and not check.difference:
            now = self._clock.now()
            question = check.due(now)
            if question is not None:
                raw, message = question
                port.write(raw)
                self._exchange.note_written(raw, message, Purpose.REQUEST)
            if self._is_accepted:
                self._is_accepted = False
                self._dialogue.known.forget()
                check.accept()
            elif now - began > UNANSWERED:
                self._publish_unproven(port, check)
            with suppress(TimeoutError):
                async with asyncio.timeout(min(check.next_time() - now, LOOK)):
                    chunk = await port.read()
                    arrived += chunk if len(arrived) < MOST_KEPT else b""
                    for item in decoder.feed(chunk):
                        if isinstance(item, Frame):
                            sender = board_at(item.address) or Board.ANY
                            check.received(sender, messages.decode(item), self._clock.now())
        return bytes(arrived)

    def _publish_unproven(self, port: Port, check: IdentityCheck) -> None:
        """Publish what is waited for, once, and once more when something arrives."""
        seen = "frames arrive, but no board answers" if check.is_answered else "nothing arrives"
        detail = f"{seen}, so the daemon sends only queries: check power and wiring"
        doubt = refuse(Token.AIRCRAFT_UNPROVEN, port=port.name, detail=detail)
        if self.doubt is None or self.doubt.reason != doubt.reason:
            self._publish(doubt)


def _device(url: str) -> tuple[int, ...] | None:
    """What tells one device from the next at the same address; None where there is none, or no file stands for it."""
    with suppress(OSError, ConfigError):
        found = Path(parse_address(url).target).stat()
        # A pseudo terminal keeps the number of its inode; its creation changes the time.
        return (found.st_dev, found.st_ino, found.st_rdev, found.st_ctime_ns)
    return None

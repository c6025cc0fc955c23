"""An orderly exit: the release, the end of a stream that would go on for ever, and a release as the last word."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from mkdaemon.errors import LinkError
from mkdaemon.link.ports.port import Port
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.link.session.release import shortest_release
from mkdaemon.link.session.scheduler import Entry
from mkdaemon.link.session.subscriptions import KINDS
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.boards import Board
from mkdaemon.telemetry.control import ReleaseOutcome

EXIT_TIME: Final = 0.6
"""Longest time an orderly exit may take [s]."""
LOOK: Final = 0.02
"""Longest wait for bytes between two looks at the release [s]."""


async def leave(
    port: Port,
    dialogue: Dialogue,
    now: Callable[[], float],
    *,
    process: Callable[[bytes], None],
    pump: Callable[[], None],
    write: Callable[[Entry], None],
) -> None:
    """Let go of the aircraft and of its streams; bounded, and the port may be gone already.

    Args:
        port: open.
        dialogue: what is said on it.
        now: tells the time [s; monotonic].
        process: takes what arrives.
        pump: writes what may be written.
        write: writes one frame at once.
    """
    dialogue.steering.leave(now())
    with suppress(LinkError, TimeoutError):
        async with asyncio.timeout(EXIT_TIME):
            pump()
            while dialogue.steering.is_releasing:
                try:
                    async with asyncio.timeout(LOOK):
                        chunk = await port.read()
                except TimeoutError:
                    chunk = b""
                process(chunk)
                pump()
            for entry in last_words(dialogue, now()):
                write(entry)
                await asyncio.sleep(dialogue.rules.wire_time(entry.raw) + dialogue.rules.gap)
            await port.drain()


def last_words(dialogue: Dialogue, now: float) -> list[Entry]:
    """Return what is said when the aircraft is released: a FlightCtrl of the fork never ends its debug stream.

    Older ones do, after 4.1 s, and their dead-man is refreshed by the request: they are not asked. A release follows.
    """
    plan, layout, dead_man = dialogue.steering.plan, dialogue.dialect.extern_control, dialogue.dialect.dead_man
    is_released = plan is not None and plan.outcome is ReleaseOutcome.CONFIRMED
    is_endless = dialogue.peers.direct is Board.FC and not dead_man.refreshed_by("d")
    if not is_endless or not is_released or "debug" not in dialogue.streams.wanted:
        return []
    stop = KINDS["debug"].ask(0)
    frames = [(Purpose.SUBSCRIPTION, stop), *((Purpose.RELEASE, frame) for frame in shortest_release(layout))]
    entries = [Entry(frame.to_frame(Board.FC), why, now + 1.0, Board.FC, frame) for why, frame in frames]
    for entry in entries:
        dialogue.counters.sent(entry)
    return entries

"""Logging of the service programs: for eyes on a terminal, JSON lines for a journal; always to stderr.

Nothing that is logged can hold up the loop or end the program: see `LogQueue`.
"""

from __future__ import annotations

import atexit
import logging
import sys
import time
from typing import Final, Literal, TextIO, cast

import structlog

from mkdaemon.cli.mkdaemon.logqueue import LogQueue
from mkdaemon.cli.terminal import guarded, on_one_line, spelled

Level = Literal["debug", "info", "warning", "error"]

RATE: Final = 5.0
"""Lines of one kind in the long run [1/s]: a client that floods the daemon with requests fills no disk."""
BURST: Final = 20.0
"""Lines of one kind at once."""
LONGEST: Final = 500
"""Longest text value in a line, tracebacks excepted [characters]."""

MOST_KINDS: Final = 200
"""Number of kinds counted separately; further ones count together."""


class KindLimit:
    """Drops lines of a kind that come too often, and counts them into the next one as `left_out`.

    A kind is what happened, how it ended and how serious it is; who caused it and with what is not part of it, or a
    flood of ever new names would have no limit.
    """

    def __init__(self) -> None:
        self._kinds: dict[tuple[str, ...], tuple[float, float, int]] = {}

    def __call__(self, _: object, method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
        """Let an event through; a processor of structlog.

        Raises:
            structlog.DropEvent: there were too many of its kind.
        """
        kind: tuple[str, ...] = (method, str(event.get("event", "")), str(event.get("status", "")))
        now = time.monotonic()
        if kind not in self._kinds and len(self._kinds) >= MOST_KINDS:
            kind = (method,)
        credit, at, left_out = self._kinds.get(kind, (BURST, now, 0))
        credit = min(BURST, credit + RATE * (now - at))
        if credit < 1.0:
            self._kinds[kind] = (credit, now, left_out + 1)
            raise structlog.DropEvent
        self._kinds[kind] = (credit - 1.0, now, 0)
        if left_out:
            event["left_out"] = left_out
        return event


def shorten_values(_: object, __: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """Cut long texts; what a client sent is whole on the bus."""
    for name, value in event.items():
        text = value if isinstance(value, str) else str(value) if isinstance(value, dict | list) else ""
        if len(text) > LONGEST:
            event[name] = text[:LONGEST] + "..."
    return event


def spell_values(_: object, __: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """Spell what would act on a terminal, or begin a line, in what others wrote; a traceback keeps its lines."""
    for name, value in event.items():
        if isinstance(value, str):
            event[name] = spelled(value) if name == "exception" else on_one_line(value)
    return event


def configure(level: Level) -> None:
    """Set up structlog once, at the program's start, and put `sys.stderr` behind a queue for everything else."""
    is_terminal = sys.stderr.isatty()
    queue = LogQueue(sys.stderr.fileno())
    stream = cast("TextIO", queue)
    sys.stderr = guarded(stream)
    atexit.register(queue.drain)
    renderer: structlog.typing.Processor = (
        structlog.dev.ConsoleRenderer() if is_terminal else structlog.processors.JSONRenderer()
    )
    structlog.configure(
        processors=[
            KindLimit(),
            shorten_values,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            spell_values,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(getattr(logging, level.upper())),
        logger_factory=structlog.WriteLoggerFactory(stream),
        cache_logger_on_first_use=True,
    )

"""What is shown of a flight on the command line: what the daemon waits for, where the aircraft is, how it ended."""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Final

from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.terminal import drawing_stream, on_one_line
from mkdaemon.client import Lease, Vehicle
from mkdaemon.client.taskerrors import background
from mkdaemon.errors import MkError
from mkdaemon.reading.facts import DEAD_RECKONING, age_words

PROGRESS_PERIOD: Final = 0.2
"""Between two lines of progress on a terminal [s]."""
LOG_PERIOD: Final = 1.0
"""The same without a terminal, and with `--json` [s]."""
SHOWN_AFTER: Final = 0.3
"""How long the daemon has to show a lease that it has granted, before a line says that it has not [s]."""

CLEAR: Final = "\r\x1b[K"
"""Clears the line of progress on a terminal."""

BELIEVED: Final = 1.5
"""An estimate is shown while its last image is no older [s]; then the daemon itself flies level."""
LAST_WORD: Final = 1.0
"""Longest wait, when a flight has ended, for the daemon to say that the aircraft is released [s]."""

Position = tuple[float, float, float]


class Shown:
    """What has been seen of the flight.

    Attributes:
        position: the newest estimate of where the aircraft is [m]; None while no image has shown it for a while.
        image_age: of the image behind it [s].
        goal: where the daemon says it is to be [m].
    """

    def __init__(self, clear: str = "") -> None:
        """Begin.

        Args:
            clear: takes the line of progress away, where there is one.
        """
        self.position: Position | None = None
        self.image_age = 0.0
        self.goal: Position | None = None
        self._clear = clear

    def print_line(self, words: str) -> None:
        """Print a line on standard output; the line of progress is taken away first."""
        _put(self._clear)
        print(words, flush=True)


@asynccontextmanager
async def leased(uav: Vehicle, connection: Connection, *, force: bool) -> AsyncIterator[Lease]:
    """Hold the lease, and say on standard error what the pilot's hands do, until the aircraft is released.

    While his throttle caps ours it is said in capitals.

    Raises:
        MkError: see `uav.lease()`.
    """
    released = asyncio.Event()
    released.set()

    async def show_hands() -> None:
        hands, has_flown = "", False
        clear = CLEAR if sys.stderr.isatty() and not connection.json else ""
        async with uav.control.status.subscribed() as statuses:
            async for status in statuses:
                is_free = status.phase is status.phase.FREE
                words = f"the pilot {status.hands}"
                words = words if status.pilots_throttle is None else words.upper()
                is_leaving = status.phase is status.phase.RELEASING
                has_flown = has_flown or status.phase is status.phase.FLYING
                # On the ground, nothing that has not flown needs a pilot to take over.
                if words != hands and not is_free and (has_flown or not is_leaving):
                    hands = words
                    _put(f"{clear}{on_one_line(hands)}\n")
                if is_free or is_leaving:
                    released.set()
                else:
                    released.clear()

    async with background(show_hands()):
        try:
            async with uav.lease(force=force) as lease:
                yield lease
        finally:
            with suppress(TimeoutError):
                async with asyncio.timeout(LAST_WORD):
                    await released.wait()


@asynccontextmanager
async def showing(
    uav: Vehicle, lease: Lease, connection: Connection, goal: Callable[[], Position | None]
) -> AsyncIterator[Shown]:
    """Show on standard error what the daemon waits for, then where the aircraft is."""
    is_terminal = sys.stderr.isatty() and not connection.json
    shown = Shown(CLEAR if is_terminal else "")

    async def follow() -> None:
        async with uav.watch("control/estimate", "control/error") as samples:
            async for sample in samples:
                if sample.suffix == "control/error":
                    shown.goal = sample.value.goal
                else:
                    shown.image_age = sample.value.image_age
                    shown.position = sample.value.position if shown.image_age <= BELIEVED else None

    async def show() -> None:
        last = ""
        while True:
            if lease.status is None:  # it was granted a moment ago
                await asyncio.sleep(SHOWN_AFTER)
            line = _line(lease, shown, goal() or shown.goal)
            if is_terminal:
                _put(f"{CLEAR}{on_one_line(line)}")
            elif line != last:
                print(line, file=sys.stderr, flush=True)
            last = line
            await asyncio.sleep(PROGRESS_PERIOD if is_terminal else LOG_PERIOD)

    try:
        async with background(follow(), show()):
            yield shown
    finally:
        if is_terminal:
            print(file=sys.stderr)


@asynccontextmanager
async def flying(
    connection: Connection, goal: Callable[[], Position | None] = lambda: None, *, force: bool
) -> AsyncIterator[tuple[Vehicle, Lease, Shown]]:
    """Hold the lease and show the flight; see `leased` and `showing`.

    Args:
        connection: which vehicle.
        goal: where it is to be; where the daemon says so by default.
        force: take the lease from its holder.
    """
    async with (
        connection.open() as uav,
        leased(uav, connection, force=force) as lease,
        showing(uav, lease, connection, goal) as shown,
    ):
        yield uav, lease, shown


def _put(drawing: str) -> None:
    """Draw on standard error."""
    stream = drawing_stream(sys.stderr)
    stream.write(drawing)
    stream.flush()


def _line(lease: Lease, shown: Shown, goal: Position | None) -> str:
    """The line of progress; there is no error to a goal while the position is calculated without images."""
    status, position = lease.status, shown.position
    if not lease.is_engaged or status is None or not status.phase.is_streamed:
        return lease.reason
    # What the pilot does meanwhile is said once, by itself.
    words = [status.stage.partition(":")[0]] if status.stage else []
    if position is not None:
        words.append(f"at {metres(position)}")
        if shown.image_age > DEAD_RECKONING:
            words.append(f"no image for {age_words(shown.image_age)}")
        elif goal is not None:
            words.append(f"{100 * math.dist(position, goal):.0f} cm from the goal")
    return ", ".join(words) or lease.reason


def metres(position: Position | None) -> str:
    """A position in words."""
    return "an unknown place" if position is None else "x {:+.2f} y {:+.2f} z {:.2f} m".format(*position)


async def read_position(uav: Vehicle) -> Position:
    """Where the aircraft was last believed to be [m].

    Raises:
        MkError: the daemon publishes no estimate.
    """
    found = await uav.control.estimate.latest()
    if found is None:
        raise MkError("the daemon publishes no estimate: see `mkctl get control/status`")
    return found.value.position


def conclude(shown: Shown, goal: Position | None, within: float, connection: Connection) -> int:
    """Print how far from the goal the flight ended; the exit code."""
    if shown.position is None or goal is None:
        connection.show({"position": None, "error": None}, "no image showed where it ended")
        return 1
    error = math.dist(shown.position, goal)
    words = f"ended at {metres(shown.position)}, {100 * error:.0f} cm from the goal"
    connection.show({"position": shown.position, "error": error}, words)
    return 0 if error <= within else 1

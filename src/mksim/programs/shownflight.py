"""A flight in virtual time, shown to clients: its values on a Zenoh bus, under a name, with the answers a viewer needs.

What is published inside the process is put on the bus as it is, a last value is answered with the age it has in virtual
time, and `do/abort` and `do/release` reach the daemon that flies. Nothing else is answered, and no setpoint is taken.
"""

from __future__ import annotations

import asyncio
import select
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from typing import Final

import msgpack
import zenoh
from pydantic import BaseModel

from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import encode, encoding_of, with_age
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.names import key
from mkdaemon.bus.session import session_config
from mkdaemon.clock import Clock
from mkdaemon.errors import MkError
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.command import CommandResult
from mksim.programs.rehearsal import Show, ShowOn
from mksim.programs.virtualports import LocalBus

VEHICLE: Final = "demo"
"""Name of the shown vehicle."""
ANSWERED: Final = ("do/abort", "do/release")
"""Verbs that a viewer may ask."""
PATIENCE: Final = 5.0
"""Longest wait for the daemon's answer [s]."""
STARTUP: Final = 60.0
"""Longest wait for the viewer's page [s]; a cold start imports a lot."""


@contextmanager
def shown_at(endpoint: str) -> Iterator[ShowOn]:
    """A bus at an endpoint on which a flight is shown; clients may come before the flight begins.

    Args:
        endpoint: to listen at.
    """
    session = zenoh.open(session_config("peer", listen=[endpoint]))
    try:
        yield lambda bus, clock: _showing(session, bus, clock)
    finally:
        session.close()  # type: ignore[no-untyped-call]


@contextmanager
def _showing(session: zenoh.Session, bus: LocalBus, clock: Clock) -> Iterator[Show]:
    """Show what is published on a bus inside the process, and answer, while the context lasts."""
    loop = asyncio.get_running_loop()
    publishers: dict[str, zenoh.Publisher] = {}
    whole = key(VEHICLE, "")

    def follow(suffix: str, value: BaseModel) -> None:
        if suffix not in publishers:
            drop = zenoh.CongestionControl.DROP
            publishers[suffix] = session.declare_publisher(whole + suffix, congestion_control=drop)
        publishers[suffix].put(encode(value), encoding=encoding_of(type(value)))

    def obey(query: zenoh.Query, suffix: str) -> None:
        """Hand a verb to the daemon, on its loop; the answer leaves from there."""
        asked = {} if query.payload is None else msgpack.unpackb(query.payload.to_bytes())

        async def ask() -> None:
            # `PATIENCE` counts on the loop's own clock, which is the flight's.
            with suppress(TimeoutError):
                async with asyncio.timeout(PATIENCE):
                    result = await bus.ask(suffix, **asked)
                query.reply(whole + suffix, encode(result), encoding=encoding_of(CommandResult))
            query.drop()  # type: ignore[no-untyped-call]

        loop.call_soon_threadsafe(loop.create_task, ask())

    def on_query(query: zenoh.Query) -> None:
        suffix = str(query.key_expr).removeprefix(whole)
        if suffix in ANSWERED:
            with suppress(RuntimeError):  # the flight is over
                obey(query, suffix)
            return
        now = clock.now()
        for known, value in list(bus.values.items()):
            if isinstance(value, Stamped) and query.key_expr.intersects(whole + known):
                packed = with_age(encode(value), max(0.0, now - value.stamp.monotonic))
                query.reply(whole + known, packed, encoding=encoding_of(type(value)))

    with ExitStack() as stack:
        handler = direct(on_query)
        stack.enter_context(session.declare_queryable(f"{whole}**", handler))
        stack.enter_context(session.liveliness().declare_token(f"{whole}alive"))
        yield follow


@contextmanager
def viewer(endpoint: str, *, browser: bool) -> Iterator[tuple[str, Popen[str]]]:
    """`mkctl view` as a separate process, ended on leaving: address of its page, and the process.

    Args:
        endpoint: of the bus it looks at.
        browser: it opens the page.

    Raises:
        MkError: it did not start; says why.
    """
    words = ("view", "--port", "0", "--vehicle", VEHICLE, "--connect", endpoint)
    command = [sys.executable, "-m", "mkdaemon.cli.mkctl.app", *words, *([] if browser else ["--no-browser"])]
    process = Popen(command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, text=True)
    try:
        assert process.stdout is not None and process.stderr is not None
        line = process.stdout.readline() if select.select([process.stdout], [], [], STARTUP)[0] else ""
        if "http" not in line:
            process.terminate()
            last = process.stderr.read().strip().splitlines()
            raise MkError(f"the viewer did not start: {last[-1] if last else 'no word from it'}")
        yield "http" + line.partition("http")[2].partition(";")[0], process
    finally:
        process.terminate()
        with suppress(TimeoutExpired):
            process.wait(3.0)
        process.kill()
        process.wait()
        for stream in (process.stdout, process.stderr):
            if stream is not None:
                stream.close()


@contextmanager
def looked_at(*, is_quiet: bool, is_headless: bool) -> Iterator[ShowOn]:
    """A bus with a viewer at it; on a terminal its page stays, with the end of the flight, until Ctrl-C.

    Args:
        is_quiet: print nothing on standard output.
        is_headless: open no browser, and wait for none.

    Raises:
        MkError: the viewer did not start.
    """
    is_watched = sys.stdout.isatty() and not (is_quiet or is_headless)
    with (
        reserved_endpoint() as endpoint,
        shown_at(endpoint) as show_on,
        viewer(endpoint, browser=not is_headless) as (address, process),
    ):
        print(f"the page is at {address}", file=sys.stderr if is_quiet else sys.stdout, flush=True)
        yield show_on
        if is_watched:
            print("the page shows the end of the flight; Ctrl-C ends it")
            with suppress(KeyboardInterrupt):
                process.wait()

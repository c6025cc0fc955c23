"""`python -m lab fuzz --bus`: a stranger puts, deletes, asks and shows tokens under every kind of key expression.

Real time: `mkdaemon run` as a process before simulated boards, and beside it programs that subscribe: `mkctl watch`,
`mkctl log record`, `mkctl view` and the gateways. None may end or write a traceback; the daemon must go on answering.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import zenoh

from lab.campaign import Row
from lab.fuzz.requests import LOOK_PERIOD, Nonsense, ended, holds, is_silent, tracebacks
from lab.rigs.flown import flown, observed
from lab.rigs.processes import MKCTL, PROGRAM, VEHICLE, DaemonProcess, Program
from mkdaemon.bus.codec import encoding_of
from mkdaemon.bus.keys import KEYS
from mkdaemon.bus.session import session_config
from mkdaemon.client import Vehicle

AT_ONCE: Final = 20
"""Pieces of nonsense between two pauses."""
PAUSE: Final = 0.01
"""After these [s]: about 1,000 a second, where the machine has time."""
SETTLING: Final = 2.0
"""For what is under way at the end [s]."""
LIMITS: Final = {"growth_mb": 32.0, "kept_mb": 6.0}
"""Of the daemon's memory, most at any time against the beginning: what waits for answers is bounded to 8, and the first
5,000 queries took 15 (peak); and at the end against half-way: five times 5,000 queries more took 4 in all [MiB]."""
_CHUNKS: Final = ("*", "**", "@x", "mk", "mk1", VEHICLE, "setpoint", "do", "stick", "client", "alive", "a" * 200, "ü")
_ENDS: Final = ("mk/**", "**", "*/**", "mk/*/**", "mk/*/setpoint/*", f"mk/{VEHICLE}/**", f"mk/{VEHICLE}/setpoint/**")
_ENCODINGS: Final = (
    *("", "application/msgpack", "application/json", "text/plain;ä", "application/msgpack;mk.", "x" * 200),
)
"""Zenoh 1.10 panics in the sender of one that is longer than 255 bytes."""
_PROOFS: Final = (None, b"", bytes(32), bytes(40), bytes(33), bytes(400))
_SPARED: Final = frozenset({"do/release", "do/abort", "do/cancel"})
"""Requests that would rightly do something although they say nothing."""
_PARAMETERS: Final = ("", "?past=nan", "?past=1e400;ahead=-1", "?_time=[..]", "?a=b;a=c;;=", "?" + "x" * 500)


class BusStranger:
    """Sends nonsense through a session of its own.

    Attributes:
        sent: by kind.
        malformed: that Zenoh itself did not send.
    """

    def __init__(self, endpoint: str, nonsense: Nonsense) -> None:
        self.sent, self.malformed, self._nonsense = Counter[str](), 0, nonsense
        self._session = zenoh.open(session_config("client", connect=[endpoint]))
        self._tokens: list[zenoh.LivelinessToken] = []
        models = [encoding_of(spec.carries) for spec in KEYS if spec.carries is not None]
        self._encodings = (*_ENCODINGS, *dict.fromkeys(models))

    def close(self) -> None:
        """End the session."""
        self._session.close()  # type: ignore[no-untyped-call]

    def strike(self) -> None:
        """Send one piece, unless Zenoh knows better."""
        rng = self._nonsense.rng
        kind, (where, payload) = rng.choice(("put", "put", "put", "delete", "get", "token")), self._place()
        try:
            if kind == "put":
                more: dict[str, Any] = {"encoding": rng.choice(self._encodings), "attachment": rng.choice(_PROOFS)}
                if rng.random() < 0.3:
                    at = datetime.fromtimestamp(rng.choice((0, 1, 2**31, 4e9)), UTC)
                    more["timestamp"] = zenoh.Timestamp(at, bytes([1]) * 16)
                self._session.put(where, payload, **more)
            elif kind == "delete":
                self._session.delete(where)
            elif kind == "get":
                asked = where + rng.choice(_PARAMETERS)
                handler: zenoh.handlers.Callback[zenoh.Reply] = zenoh.handlers.Callback(
                    lambda reply: None, lambda: None, indirect=False
                )
                self._session.get(asked, handler, payload=payload, attachment=rng.choice(_PROOFS), timeout=5)
            else:
                self._tokens.append(self._session.liveliness().declare_token(where))
                if len(self._tokens) > 8:
                    self._tokens.pop(rng.randrange(8)).undeclare()  # type: ignore[no-untyped-call]
        except (zenoh.ZError, ValueError):
            self.malformed += 1
        self.sent[kind] += 1

    def _place(self) -> tuple[str, bytes]:
        """A key expression, and what is sent there."""
        rng, nonsense = self._nonsense.rng, self._nonsense
        kind = rng.randrange(4)
        if kind == 0:
            return rng.choice(_ENDS), nonsense.payload(("stamp", "epoch"))
        if kind == 1:
            chunks = [rng.choice(_CHUNKS) for _ in range(rng.randrange(1, 7))]
            return "/".join(chunks), nonsense.payload(("stamp", "epoch"))
        spec = rng.choice([spec for spec in KEYS if spec.suffix not in _SPARED])
        names = () if spec.carries is None else tuple(spec.carries.model_fields)
        suffix = spec.pattern.replace("*", rng.choice(("fc", "nc", "*", "x", "**", "@y")))
        payload = b"" if rng.random() < 0.2 else nonsense.payload(names)
        return f"mk/{VEHICLE if kind == 2 else rng.choice(_CHUNKS)}/{suffix}", payload


def readers(endpoint: str, folder: Path) -> dict[str, tuple[str, ...]]:
    """Programs that subscribe, as a user starts them, by name: what Python runs."""
    whose = ("--connect", endpoint, "--vehicle", VEHICLE)
    found = {
        "watch": (*MKCTL, "watch", "**", *whose),
        "record": (*MKCTL, "log", "record", "--folder", str(folder / "ground"), *whose),
        "view": (*MKCTL, "view", "--port", "0", "--no-browser", *whose),
        "mavlink": (*PROGRAM, "gateway", "mavlink", "--link", "udpout:127.0.0.1:9", *whose),
        "foxglove": (*PROGRAM, "gateway", "foxglove", "--port", "0", *whose),
    }
    needs = {"mavlink": "pymavlink", "foxglove": "websockets"}
    return {name: words for name, words in found.items() if name not in needs or find_spec(needs[name]) is not None}


@asynccontextmanager
async def _reading(name: str, words: Sequence[str], found: Row) -> AsyncIterator[None]:
    """Run a reader while the context lasts, and judge it."""
    reader = await Program.start(*words, is_read=False)
    try:
        yield
    finally:
        if reader.code is not None:
            found["ended"].append(f"{name}: exit code {reader.code}")
        await reader.end(signal.SIGINT)
    found["tracebacks"] += tracebacks(reader.errors)


async def fuzz_bus(count: int, seed: int, *, only: Sequence[str] | None = None) -> Row:
    """Run a daemon and its readers, or `only` some of them by name, and send nonsense.

    Returns:
        What was `sent`, by kind, and `malformed`, that Zenoh itself did not send; `silences`, looks at which the link's
        health was too old or not answered; see `LIMITS`; `tracebacks` of all programs, those that `ended` by
        themselves, and the daemon's `exit_code`; `holds`.

    Raises:
        TimeoutError: the daemon did not come up.
    """
    found: Row = {"ended": [], "tracebacks": 0}
    async with flown(observed(seed, nc="0.24"), on_tcp=True, waits=False) as one, AsyncExitStack() as stack:
        for reader, words in readers(one.daemon.endpoint, one.folder).items():
            if only is None or reader in only:
                await stack.enter_async_context(_reading(reader, words, found))
        await asyncio.sleep(SETTLING)
        before = one.daemon.resident_mb()
        found |= await _send(one.daemon, one.client, Nonsense(seed), count)
        found["growth_mb"] = round(one.daemon.most_resident_mb() - before, 1)
        await stack.aclose()
        end = await ended(one.daemon)
    found |= {"exit_code": end["exit_code"], "tracebacks": found["tracebacks"] + end["tracebacks"]}
    return found | {"holds": holds(found, LIMITS)}


async def _send(daemon: DaemonProcess, client: Vehicle, nonsense: Nonsense, count: int) -> Row:
    """Send it all, and look at the daemon now and then."""
    stranger, began, next_look = BusStranger(daemon.endpoint, nonsense), time.monotonic(), 0.0
    half_way, silences = 0.0, 0
    for number in range(count):
        stranger.strike()
        if number == count // 2:
            half_way = daemon.resident_mb()
        if number % AT_ONCE:
            continue
        await asyncio.sleep(PAUSE)
        elapsed = time.monotonic() - began
        if elapsed >= next_look:
            next_look = elapsed + LOOK_PERIOD
            silences += await is_silent(client)
            print(f"{elapsed:4.0f} s: {dict(stranger.sent)}", file=sys.stderr)
    await asyncio.sleep(SETTLING)
    silences += await is_silent(client)
    kept = round(daemon.resident_mb() - half_way, 1)
    await asyncio.to_thread(stranger.close)
    return {"sent": stranger.sent, "malformed": stranger.malformed, "silences": silences, "kept_mb": kept}

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
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import zenoh

from lab.fuzz.nonsense import Nonsense
from lab.fuzz.requests import LONGEST_SILENCE, LOOK_PERIOD
from lab.rigs.flown import flown, observed
from lab.rigs.processes import MKCTL, PROGRAM, VEHICLE, DaemonProcess, Program
from mkdaemon.bus.codec import encoding_of
from mkdaemon.bus.keys import KEYS
from mkdaemon.bus.session import session_config
from mkdaemon.client import Vehicle
from mkdaemon.telemetry.refusals import Token

AT_ONCE: Final = 20
"""Pieces of nonsense between two pauses."""
PAUSE: Final = 0.01
"""After these [s]: about 1,000 a second, where the machine has time."""
SETTLING: Final = 2.0
"""For what is under way at the end [s]."""
MOST_GROWTH_MB: Final = 32.0
"""Of the daemon's memory [MiB]: what waits for answers is bounded to 8, and the first 5,000 queries took 15 (peak)."""
MOST_KEPT_MB: Final = 6.0
"""Of it from half-way on [MiB]: five times 5,000 queries more took 4 in all, and ever less."""
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


@dataclass
class BusFindings:
    """What a run showed.

    Attributes:
        count: how much nonsense was sent.
        sent: by kind.
        malformed: that Zenoh itself did not send.
        seconds: how long it took.
        silences: looks at which the link's health was too old, or not told.
        growth_mb: of the daemon's memory, most at any time against the beginning.
        kept_mb: of it, at the end against half-way.
        tracebacks: by program.
        ended: programs that ended by themselves.
        exit_code: of the daemon's end by SIGTERM.
    """

    count: int
    sent: Counter[str] = field(default_factory=Counter)
    malformed: int = 0
    seconds: float = 0.0
    silences: int = 0
    growth_mb: float = 0.0
    kept_mb: float = 0.0
    tracebacks: Counter[str] = field(default_factory=Counter)
    ended: list[str] = field(default_factory=list)
    exit_code: int = 0

    @property
    def holds(self) -> bool:
        """Whether nothing went wrong."""
        wrong = (self.silences, self.tracebacks.total(), self.ended, self.exit_code)
        return not any(wrong) and self.growth_mb <= MOST_GROWTH_MB and self.kept_mb <= MOST_KEPT_MB


class BusStranger:
    """Sends nonsense through a session of its own."""

    def __init__(self, endpoint: str, nonsense: Nonsense, findings: BusFindings) -> None:
        self._nonsense, self._findings = nonsense, findings
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
            self._findings.malformed += 1
        self._findings.sent[kind] += 1

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
async def _reading(name: str, words: Sequence[str], findings: BusFindings) -> AsyncIterator[None]:
    """Run a reader while the context lasts, and judge it."""
    reader = await Program.start(*words, is_read=False)
    try:
        yield
    finally:
        if reader.code is not None:
            findings.ended.append(f"{name}: exit code {reader.code}")
        await reader.end(signal.SIGINT)
    _judge(name, reader.errors, findings)


def _judge(name: str, errors: str, findings: BusFindings) -> None:
    if "Traceback" in errors:
        findings.tracebacks[name] += errors.count("Traceback")
        print(f"{name}: {errors[-5000:]}", file=sys.stderr)


async def _health_is_late(client: Vehicle) -> bool:
    try:
        health = await client.get("link/health")
    except Exception as error:  # noqa: BLE001
        if getattr(error, "token", None) == Token.BUSY:
            return False  # it lives, and says that it has too much to do
        print(f"an honest client: {type(error).__name__}: {error}", file=sys.stderr)
        return True
    age = None if health is None else health.age
    if age is None or age > LONGEST_SILENCE:
        print(f"an honest client: link/health is {age} s old (None: no answer in time)", file=sys.stderr)
        return True
    return False


async def fuzz_bus(count: int, seed: int, *, only: Sequence[str] | None = None) -> BusFindings:
    """Run a daemon and its readers, and send nonsense.

    Args:
        count: puts, deletions, queries and tokens.
        seed: of the nonsense.
        only: names of the readers that run; all by default.

    Raises:
        TimeoutError: the daemon did not come up.
    """
    findings = BusFindings(count)
    async with flown(observed(seed, nc="0.24"), on_tcp=True, waits=False) as one, AsyncExitStack() as stack:
        daemon = one.daemon
        for reader, words in readers(daemon.endpoint, one.folder).items():
            if only is None or reader in only:
                await stack.enter_async_context(_reading(reader, words, findings))
        await asyncio.sleep(SETTLING)
        before = daemon.resident_mb()
        await _send(daemon, one.client, Nonsense(seed), findings)
        findings.growth_mb = round(daemon.most_resident_mb() - before, 1)
        await stack.aclose()
        findings.exit_code = await daemon.end(signal.SIGTERM)
        _judge("daemon", daemon.errors, findings)
    return findings


async def _send(daemon: DaemonProcess, client: Vehicle, nonsense: Nonsense, findings: BusFindings) -> None:
    """Send it all, and look at the daemon now and then."""
    stranger, began, next_look = BusStranger(daemon.endpoint, nonsense, findings), time.monotonic(), 0.0
    half_way = 0.0
    for number in range(findings.count):
        stranger.strike()
        if number == findings.count // 2:
            half_way = daemon.resident_mb()
        if number % AT_ONCE:
            continue
        await asyncio.sleep(PAUSE)
        elapsed = time.monotonic() - began
        if elapsed >= next_look:
            next_look = elapsed + LOOK_PERIOD
            findings.silences += await _health_is_late(client)
            print(f"{elapsed:4.0f} s: {dict(findings.sent)}", file=sys.stderr)
    await asyncio.sleep(SETTLING)
    findings.seconds = round(time.monotonic() - began, 1)
    findings.silences += await _health_is_late(client)
    findings.kept_mb = round(daemon.resident_mb() - half_way, 1)
    await asyncio.to_thread(stranger.close)

"""`python -m lab fuzz`: a running daemon is asked, told and configured nonsense; it must live, and say what it refuses.

Real time: `mkdaemon run` as a process, the simulated boards on a TCP port, a stranger's session of Zenoh. Requests are
well formed, wrong in one field, or bytes; setpoints stand below the secret root, some with the holder's signature; the
configuration file is damaged and read again (SIGUSR1).
"""

from __future__ import annotations

import asyncio
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

import zenoh

from lab.fuzz.nonsense import Nonsense
from lab.rigs.flown import flown, observed
from lab.rigs.processes import VEHICLE, DaemonProcess
from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import decode_map
from mkdaemon.bus.session import session_config
from mkdaemon.bus.setpointroot import below
from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.telemetry.refusals import TOKENS, Token
from mkdaemon.telemetry.setpoint import SETPOINTS
from mkdaemon.telemetry.signature import sign
from mkdaemon.telemetry.status import Status

PERIOD: Final = 0.02
"""Between two pieces of nonsense [s]: below the rates at which the daemon sheds what is too much."""
IN_FLIGHT: Final = 12
"""Queries that wait for their answers at a time; the daemon works on more."""
FILE_PERIOD: Final = 3.0
"""Between two damaged configuration files [s]."""
LOOK_PERIOD: Final = 2.0
"""Between two looks of an honest client, who takes the lease back too [s]."""
LONGEST: Final = 500
"""Of a setpoint [bytes]."""
WARM: Final = 0.2
"""Share of the time after which memory is looked at for the first time."""
MOST_GROWTH_MB: Final = 8.0
"""From there to the end."""
MOST_DESCRIPTORS: Final = 3
"""More open files at the end than when it was warm."""
LAST_ANSWERS: Final = 60.0
"""Longest wait for what is still to be answered at the end [s]."""
LONGEST_SILENCE: Final = 3.0
"""Of `link/health`, which comes every second [s]."""


@dataclass
class Findings:
    """What a run showed.

    Attributes:
        seconds: how long it was fuzzed.
        asked: queries, setpoints and files, by kind.
        refused: refusals by token.
        unnamed: refusals without a known token or a reason.
        unanswered: queries without any answer.
        uncounted: setpoints refused that `control/status` did not count.
        unread: files without a word in the log.
        silences: looks at which the link's health was too old.
        growth_mb: of the daemon's memory, from when it was warm.
        more_descriptors: the same of its open files.
        tracebacks: on its standard error.
        exit_code: of its end by SIGTERM.
    """

    seconds: float
    asked: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    unnamed: list[str] = field(default_factory=list)
    unanswered: list[str] = field(default_factory=list)
    uncounted: int = 0
    unread: int = 0
    silences: int = 0
    growth_mb: float = 0.0
    more_descriptors: int = 0
    tracebacks: int = 0
    exit_code: int = 0

    @property
    def holds(self) -> bool:
        """Whether nothing went wrong."""
        wrong = (self.unnamed, self.unanswered, self.uncounted, self.unread, self.silences, self.tracebacks)
        is_small = self.growth_mb <= MOST_GROWTH_MB and self.more_descriptors <= MOST_DESCRIPTORS
        return not any(wrong) and is_small and self.exit_code == 0


class Stranger:
    """Asks and tells, and keeps what is answered.

    Attributes:
        open: queries that are still to be answered.
        read_files: configuration files of which the daemon's log says what became of them.
    """

    def __init__(self, endpoint: str, findings: Findings) -> None:
        self.session = zenoh.open(session_config("client", connect=[endpoint]))
        self.open: dict[int, str] = {}
        self.read_files = self._count = 0
        self._findings = findings
        self._log = self.session.declare_subscriber(f"mk/{VEHICLE}/event/log", self._heard_log)

    def ask(self, suffix: str, payload: bytes) -> None:
        """Send a query, unless its key cannot be."""
        number = self._count = self._count + 1
        answers: list[bytes] = []

        def heard(reply: zenoh.Reply) -> None:
            sample = reply.ok or reply.err
            answers.append(b"" if sample is None else sample.payload.to_bytes())

        def ended() -> None:
            self._judge(self.open.pop(number), answers)

        self.open[number] = f"{suffix} {payload[:40]!r}"
        try:
            handler: zenoh.handlers.Callback[zenoh.Reply] = zenoh.handlers.Callback(heard, ended, indirect=False)
            self.session.get(f"mk/{VEHICLE}/{suffix}", handler, payload=payload, timeout=900)
        except zenoh.ZError:
            self.open.pop(number, None)
            return
        self._findings.asked["queries"] += 1

    def _judge(self, asked: str, answers: list[bytes]) -> None:
        if not answers:
            self._findings.unanswered.append(asked)
            return
        answer = decode_map(answers[0])
        if answer.get("status") in (Status.ACCEPTED, Status.NOT_OBSERVABLE):
            return  # it was no nonsense after all
        token, reason = str(answer.get("token")), answer.get("reason")
        self._findings.refused[token] += 1
        if token not in TOKENS or token == Token.INTERNAL or not reason:
            self._findings.unnamed.append(f"{asked}: {answer}")

    def _heard_log(self, sample: zenoh.Sample) -> None:
        text = str(decode_map(sample.payload.to_bytes()).get("text"))
        self.read_files += text.startswith(("configuration reloaded", "configuration not reloaded"))

    def put(self, root: str, suffix: str, payload: bytes, proof: bytes) -> None:
        """Put a setpoint below a root."""
        self.session.put(f"mk/{VEHICLE}/{below(root, suffix)}", payload, attachment=proof)
        self._findings.asked["setpoints"] += 1


async def _fuzz(
    daemon: DaemonProcess, client: Vehicle, config: Path, nonsense: Nonsense, findings: Findings, *, shows: bool
) -> None:
    """Fuzz for as long as the findings say, and judge."""
    rng, (whole, write) = nonsense.rng, _opened(config)
    stranger = Stranger(daemon.endpoint, findings)
    counted = await _refused_setpoints(client)
    root, secret = "", ""
    began, next_look, next_file, next_line = time.monotonic(), 0.0, 0.0, 10.0
    warm: tuple[float, int] | None = None
    while (elapsed := time.monotonic() - began) < findings.seconds:
        if elapsed >= next_look:
            next_look = elapsed + LOOK_PERIOD
            root, secret = await _lease(client) or (root, secret)
            findings.silences += await _is_silent(client)
        if elapsed >= next_file:
            next_file = elapsed + FILE_PERIOD
            write(nonsense.file(whole))
            daemon.send_signal(signal.SIGUSR1)
            findings.asked["files"] += 1
        if warm is None and elapsed > WARM * findings.seconds:
            warm = daemon.resident_mb(), daemon.descriptors()
        if rng.random() < 0.5 and root:
            suffix = rng.choice(SETPOINTS).suffix
            payload = nonsense.payload(("epoch", "sequence", "ttl"))[:LONGEST]
            stranger.put(root, suffix, payload, sign(secret, suffix, payload) if rng.random() < 0.5 else bytes(32))
        elif len(stranger.open) < IN_FLIGHT:
            stranger.ask(*nonsense.request())
        if shows and elapsed >= next_line:
            next_line = elapsed + 10.0
            print(f"{elapsed:4.0f} s: {dict(findings.asked)}, {daemon.resident_mb():.1f} MiB", file=sys.stderr)
        await asyncio.sleep(PERIOD)
    write(whole)
    await _last_answers(client, stranger)
    await asyncio.sleep(LOOK_PERIOD)  # `control/status` comes twice a second
    findings.unanswered += list(stranger.open.values())
    findings.uncounted = findings.asked["setpoints"] - (await _refused_setpoints(client) - counted)
    findings.unread = findings.asked["files"] - stranger.read_files
    if warm is not None:
        findings.growth_mb = round(daemon.resident_mb() - warm[0], 1)
        findings.more_descriptors = daemon.descriptors() - warm[1]
    stranger.session.close()  # type: ignore[no-untyped-call]


def _opened(config: Path) -> tuple[str, Callable[[str], object]]:
    return config.read_text(encoding="utf-8"), partial(config.write_text, encoding="utf-8")


async def _lease(client: Vehicle) -> tuple[str, str] | None:
    """Take the lease from whoever has it; the root of setpoints and the secret, or None where it is refused."""
    answer = await client.command("do", "lease", {"action": "take", "holder": "fuzz", "force": True, "ttl": 60.0})
    reply = answer.reply
    return None if not reply else (str(reply["setpoint_root"]), str(reply["secret"]))


async def _refused_setpoints(client: Vehicle) -> int:
    status = await client.control.status.latest()
    return 0 if status is None else status.value.refused


async def _is_silent(client: Vehicle) -> bool:
    health = await client.link.health.latest()
    return health is None or health.age > LONGEST_SILENCE


async def _last_answers(client: Vehicle, stranger: Stranger) -> None:
    """End the procedure that runs, and wait for what is still to be answered."""
    with suppress(MkError):
        await client.command("do", "cancel", {})
    with suppress(TimeoutError):
        await wait_until(lambda: not stranger.open, LAST_ANSWERS, 0.1)


async def fuzz(seconds: float, seed: int, *, shows: bool = False) -> Findings:
    """Run a daemon before simulated boards and fuzz it.

    Args:
        seconds: how long.
        seed: of the nonsense.
        shows: print what was done so far, every ten seconds, to standard error.

    Raises:
        TimeoutError: the daemon did not come up.
        MkError: it does not answer an honest client.
    """
    findings = Findings(seconds)
    async with flown(observed(seed, nc="0.24"), on_tcp=True) as one:
        await _fuzz(one.daemon, one.client, one.folder / "daemon.toml", Nonsense(seed), findings, shows=shows)
        findings.exit_code = await one.daemon.end(signal.SIGTERM)
        findings.tracebacks = one.daemon.errors.count("Traceback")
        if findings.tracebacks:
            print(one.daemon.errors[-5000:], file=sys.stderr)
    return findings

"""`python -m lab fuzz`: a running daemon is asked, told and configured nonsense; it must live, and say what it refuses.

Real time: `mkdaemon run` as a process, the simulated boards on a TCP port, a stranger's session of Zenoh. Requests are
well formed, wrong in one field, or bytes; setpoints stand below the secret root, some with the holder's signature; the
configuration file is damaged and read again (SIGUSR1).
"""

from __future__ import annotations

import asyncio
import json
import math
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import msgpack
import zenoh
from cyclopts import Parameter

from lab.cases import silence_log
from lab.control.corefuzz import run_sequences, shortened
from lab.rigs.processes import START, VEHICLE, DaemonProcess, connected, daemon_process
from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import decode_map
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.session import session_config
from mkdaemon.bus.setpointroot import below
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.protocol.wire import MESSAGES, Direction
from mkdaemon.telemetry.refusals import TOKENS, Token
from mkdaemon.telemetry.setpoint import SETPOINTS
from mkdaemon.telemetry.signature import sign
from mkdaemon.telemetry.status import Status
from mkdaemon.telemetry.verbs import VERBS
from mksim.config import PilotPlan, SimConfig
from mksim.runtime import Runtime
from mksim.simulation import Simulation

if TYPE_CHECKING:
    from lab.busfuzz import BusFindings

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
MOST_SHOWN: Final = 20
"""Sequences whose first breach is printed."""
LONGEST_SILENCE: Final = 3.0
"""Of `link/health`, which comes every second [s]."""
NUMBERS: Final = (
    0,
    1,
    -1,
    127,
    128,
    255,
    256,
    65535,
    2**31,
    2**63 - 1,
    -(2**63),
    0.5,
    1e308,
    math.nan,
    math.inf,
    -math.inf,
)
TEXTS: Final = (
    "",
    "fc",
    "take",
    "mk1",
    "\x00",
    "\x1b[2J",
    "\ud7ff\U0010ffff",
    "../../etc/passwd",
    "a" * 5000,
    "nan",
    "1",
)
DANGEROUS: Final = frozenset({"cmd/nc/redirect"})
"""Requests that would rightly turn the line away from the boards that are looked at."""


@dataclass
class Findings:
    """What a run showed.

    Attributes:
        seconds: how long it was fuzzed.
        asked: queries, setpoints and files, by kind.
        refused: refusals by token.
        accepted: queries that were no nonsense after all.
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
    accepted: int = 0
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


class Nonsense:
    """Draws it; the same seed draws the same."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def value(self, depth: int = 0) -> Any:
        """Anything that msgpack can say."""
        kind = self.rng.randrange(7 if depth < 3 else 4)
        if kind == 0:
            return self.rng.choice(NUMBERS)
        if kind == 1:
            return self.rng.choice(TEXTS)
        if kind == 2:
            return self.rng.randbytes(self.rng.choice((0, 1, 32, 300)))
        if kind == 3:
            return self.rng.choice((None, True, False))
        if kind == 4:
            return [self.value(depth + 1) for _ in range(self.rng.randrange(5))]
        return {self.rng.choice(TEXTS): self.value(depth + 1) for _ in range(self.rng.randrange(5))}

    def payload(self, names: tuple[str, ...]) -> bytes:
        """Of a request with these fields: bytes, a map of anything, or one with its own names."""
        kind = self.rng.randrange(4)
        if kind == 0:
            return self.rng.randbytes(self.rng.choice((0, 1, 7, 64, 5000)))
        if kind == 1:
            return bytes(msgpack.packb(self.value()))
        fields = {name: self.value(2) for name in names if self.rng.random() < 0.7}
        packed = bytearray(msgpack.packb(fields))
        if kind == 2 and packed:
            packed[self.rng.randrange(len(packed))] ^= 1 << self.rng.randrange(8)
        return bytes(packed)

    def request(self) -> tuple[str, bytes]:
        """A key below `do` or `cmd`, and a payload."""
        if self.rng.random() < 0.1:
            word = self.rng.choice(("nothing", "lease/lease", "%s%n", "a" * 300, "\u202e"))
            return f"{self.rng.choice(('do', 'cmd', 'cmd/fc', 'cmd/xx'))}/{word}", self.payload(("x",))
        suffix, names = self.rng.choice(REQUESTS)
        return suffix, self.payload(names)

    def file(self, whole: str) -> str:
        """A configuration file with some damage."""
        lines = whole.splitlines()
        for _ in range(self.rng.randrange(1, 4)):
            place, kind = self.rng.randrange(len(lines)), self.rng.randrange(5)
            if kind == 0:
                lines.insert(place, lines[place])
            elif kind == 1:
                lines[place] = lines[place][: self.rng.randrange(len(lines[place]) + 1)]
            elif kind == 2:
                name = lines[place].partition("=")[0] or "x"
                lines[place] = f"{name}= {self.rng.choice(('nan', '-1', '1e400', '[]', '{}', 'true', '2**8'))}"
            elif kind == 3:
                lines.append(f"[{self.rng.choice(('link', 'control.limiter', 'cameras', 'sim', 'x.y'))}]\nfoo = 1")
            else:
                lines[place] += self.rng.choice(("\x00", "\ufeff", "'''", "]"))
        return "\n".join(lines) + "\n"


def _requests() -> tuple[tuple[str, tuple[str, ...]], ...]:
    verbs = [(f"do/{verb.name}", tuple(verb.request.model_fields)) for verb in VERBS]
    messages = {
        f"cmd/{board.word}/{cls.spec.key}": (*cls.model_fields, "confirm")
        for cls in MESSAGES.values()
        if cls.spec.direction is Direction.TO_BOARD
        for board in cls.spec.boards
    }
    return tuple(verbs) + tuple((key, names) for key, names in messages.items() if key not in DANGEROUS)


REQUESTS: Final = _requests()


class Stranger:
    """Asks and tells, and keeps what is answered.

    Attributes:
        open: queries that are still to be answered.
        read_files: configuration files of which the daemon's log says what became of them.
    """

    def __init__(self, endpoint: str, findings: Findings) -> None:
        self.session = zenoh.open(session_config("client", connect=[endpoint]))
        self.open: dict[int, str] = {}
        self.read_files = 0
        self._findings = findings
        self._count = 0
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
            self._findings.accepted += 1
            return
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


class ConfigFile:
    """The daemon's configuration file.

    Attributes:
        whole: its text before it was damaged.
    """

    def __init__(self, path: Path) -> None:
        self.whole = path.read_text(encoding="utf-8")
        self._path = path

    def write(self, text: str) -> None:
        """Write another text."""
        self._path.write_text(text, encoding="utf-8")


async def _fuzz(
    daemon: DaemonProcess, client: Vehicle, config: ConfigFile, nonsense: Nonsense, findings: Findings, *, shows: bool
) -> None:
    """Fuzz for as long as the findings say, and judge."""
    rng = nonsense.rng
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
            config.write(nonsense.file(config.whole))
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
    config.write(config.whole)
    await _last_answers(client, stranger)
    await asyncio.sleep(LOOK_PERIOD)  # `control/status` comes twice a second
    findings.unanswered += list(stranger.open.values())
    findings.uncounted = findings.asked["setpoints"] - (await _refused_setpoints(client) - counted)
    findings.unread = findings.asked["files"] - stranger.read_files
    if warm is not None:
        findings.growth_mb = round(daemon.resident_mb() - warm[0], 1)
        findings.more_descriptors = daemon.descriptors() - warm[1]
    stranger.session.close()  # type: ignore[no-untyped-call]


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
    plan = SimConfig.model_validate({"pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed})
    with reserved_endpoint() as port, tempfile.TemporaryDirectory() as name:
        where = port.removeprefix("tcp/")
        async with (
            Runtime(Simulation(plan), listen=where).serve(),
            daemon_process(f"tcp:{where}", Path(name)) as daemon,
            connected(daemon.endpoint, patience=START) as client,
        ):
            await _fuzz(daemon, client, ConfigFile(Path(name) / "daemon.toml"), Nonsense(seed), findings, shows=shows)
            findings.exit_code = await daemon.end(signal.SIGTERM)
            findings.tracebacks = daemon.errors.count("Traceback")
            if findings.tracebacks:
                print(daemon.errors[-5000:], file=sys.stderr)
    return findings


def main(
    *,
    seconds: Annotated[float, Parameter(help="Duration [s].")] = 600.0,
    seed: Annotated[int, Parameter(help="Of the nonsense, or of the first sequence.")] = 1,
    bus: Annotated[bool, Parameter(help="Key expressions of every kind in place of requests, with readers.")] = False,
    count: Annotated[int, Parameter(help="With --bus: puts, deletions, queries and tokens.")] = 100_000,
    core: Annotated[
        bool, Parameter(help="The flight core alone, in virtual time: sequences of random events.")
    ] = False,
    seeds: Annotated[int, Parameter(help="How many sequences, with --core.")] = 20_000,
    jobs: Annotated[int, Parameter(help="How many processes, with --core.")] = 1,
    results: Annotated[
        Path | None, Parameter(help="With --core: a file of what was run; a second run goes on where the first ended.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Ask, tell and configure a running daemon nonsense for ten minutes; exit code 1 if it minds.

    It must live and not grow, answer every query, name every refusal by a token that docs/keys.md lists, count every
    setpoint that it refuses, and say of every damaged configuration file what is wrong with it, or take it up.

    With `--bus` the daemon and the programs that read from it must live and write no traceback (a few minutes).

    With --core a toy aircraft, a client, a pilot, boards and cameras do 300 random things a sequence to the flight
    core; `lab.control.corefuzz` lists what must never be, and what has to be reached.
    """
    from lab.busfuzz import fuzz_bus  # it draws its nonsense from here

    silence_log()
    if core:
        return _fuzz_core(seed, seeds, jobs, results, as_json=as_json)
    findings: Findings | BusFindings
    findings = asyncio.run(fuzz_bus(count, seed)) if bus else asyncio.run(fuzz(seconds, seed, shows=True))
    row = vars(findings) | {"holds": findings.holds}
    if as_json:
        print(json.dumps(row))
    else:
        for name, value in row.items():
            print(f"{name:18} {json.dumps(value)}")
    return 0 if findings.holds else 1


def _fuzz_core(first: int, count: int, jobs: int, results: Path | None, *, as_json: bool) -> int:
    """Run sequences of events for the flight core; exit code 1 for a broken promise, or what was not reached."""
    found = run_sequences(first, count, jobs, results)
    flown = sum(found.ticks.values())
    shares = {what: f"{100.0 * ticks / flown:.2f} %" for what, ticks in found.ticks.most_common()}
    row = {
        "sequences": found.sequences,
        "breaches": len(found.breaches),
        "virtual_s": round(found.seconds),
        "cpu_s_each": round(found.cpu / found.sequences, 3),
        "ticks": found.reached["tick"],
        "in_flight_percent": round(100.0 * found.share_in_flight, 1),
        "unreached": found.unreached,
    }
    if as_json:
        print(json.dumps(row | {"in_flight": found.ticks, "reached": found.reached, "wrong": found.breaches}))
    else:
        print(json.dumps(row))
        for what, share in shares.items():
            print(f"{share:>8} {what}")
    for seed in () if as_json else sorted(found.breaches)[:MOST_SHOWN]:
        print(f"seed {seed}: {found.breaches[seed][0]}")
    for happening in shortened(min(found.breaches)) if found.breaches else ():
        print(f"shortest of seed {min(found.breaches)}: {happening}", file=sys.stderr)
    return 1 if found.breaches or found.unreached else 0

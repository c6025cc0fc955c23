"""`python -m lab fuzz`: a running daemon is asked, told and configured nonsense; it must live, and say what it refuses.

Real time: `mkdaemon run` as a process, the simulated boards on a TCP port, a stranger's session of Zenoh. Requests are
well formed, wrong in one field, or bytes; setpoints stand below the secret root, some with the holder's signature; the
configuration file is damaged and read again (SIGUSR1). All nonsense is drawn from a seed.
"""

from __future__ import annotations

import asyncio
import math
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import msgpack
import zenoh

from lab.campaign import Row
from lab.rigs.flown import flown, observed
from lab.rigs.processes import VEHICLE, DaemonProcess
from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import decode_map
from mkdaemon.bus.session import session_config
from mkdaemon.bus.setpointroot import below
from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.protocol.wire import MESSAGES, Direction
from mkdaemon.telemetry.refusals import TOKENS, Token
from mkdaemon.telemetry.setpoint import SETPOINTS
from mkdaemon.telemetry.signature import sign
from mkdaemon.telemetry.status import Status
from mkdaemon.telemetry.verbs import VERBS

NUMBERS: Final = (
    *(0, 1, -1, 127, 128, 255, 256, 65535, 2**31, 2**63 - 1, -(2**63)),
    *(0.5, 1e308, math.nan, math.inf, -math.inf),
)
TEXTS: Final = (
    *("", "fc", "take", "mk1", "\x00", "\x1b[2J", "\ud7ff\U0010ffff", "../../etc/passwd", "a" * 5000, "nan", "1"),
)
DANGEROUS: Final = frozenset({"cmd/nc/redirect"})
"""Requests that would rightly turn the line away from the boards that are looked at."""


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
LAST_ANSWERS: Final = 60.0
"""Longest wait for what is still to be answered at the end [s]."""
LONGEST_SILENCE: Final = 3.0
"""Of `link/health`, which comes every second [s]."""
WRONG: Final = ("unnamed", "unanswered", "uncounted", "unread", "silences", "tracebacks", "ended", "exit_code")
"""Of what a run showed: all of it is nothing where the daemon bears it."""
LIMITS: Final = {"growth_mb": 8.0, "more_descriptors": 3}
"""More memory at the end than when it was warm [MiB], and more open files."""


class Stranger:
    """Asks and tells, and keeps what is answered.

    Attributes:
        asked: queries and setpoints, by kind.
        refused: refusals by token.
        unnamed: refusals without a known token or a reason.
        unanswered: queries without any answer.
        open: queries that are still to be answered.
        read_files: configuration files of which the daemon's log says what became of them.
    """

    def __init__(self, endpoint: str) -> None:
        self.session = zenoh.open(session_config("client", connect=[endpoint]))
        self.asked, self.refused = Counter[str](), Counter[str]()
        self.unnamed, self.unanswered = list[str](), list[str]()
        self.open: dict[int, str] = {}
        self.read_files = self._count = 0
        self._log = self.session.declare_subscriber(f"mk/{VEHICLE}/event/log", self._logged)

    def ask(self, suffix: str, payload: bytes) -> None:
        """Send a query, unless its key cannot be."""
        number = self._count = self._count + 1
        answers: list[bytes] = []

        def answered(reply: zenoh.Reply) -> None:
            sample = reply.ok or reply.err
            answers.append(b"" if sample is None else sample.payload.to_bytes())

        def ended() -> None:
            self._judge(self.open.pop(number), answers)

        self.open[number] = f"{suffix} {payload[:40]!r}"
        try:
            handler: zenoh.handlers.Callback[zenoh.Reply] = zenoh.handlers.Callback(answered, ended, indirect=False)
            self.session.get(f"mk/{VEHICLE}/{suffix}", handler, payload=payload, timeout=900)
        except zenoh.ZError:
            self.open.pop(number, None)
            return
        self.asked["queries"] += 1

    def _judge(self, asked: str, answers: list[bytes]) -> None:
        if not answers:
            self.unanswered.append(asked)
            return
        answer = decode_map(answers[0])
        if answer.get("status") in (Status.ACCEPTED, Status.NOT_OBSERVABLE):
            return  # it was no nonsense after all
        token, reason = str(answer.get("token")), answer.get("reason")
        self.refused[token] += 1
        if token not in TOKENS or token == Token.INTERNAL or not reason:
            self.unnamed.append(f"{asked}: {answer}")

    def _logged(self, sample: zenoh.Sample) -> None:
        text = str(decode_map(sample.payload.to_bytes()).get("text"))
        self.read_files += text.startswith(("configuration reloaded", "configuration not reloaded"))

    def put(self, root: str, suffix: str, payload: bytes, proof: bytes) -> None:
        """Put a setpoint below a root."""
        self.session.put(f"mk/{VEHICLE}/{below(root, suffix)}", payload, attachment=proof)
        self.asked["setpoints"] += 1


async def _fuzz(daemon: DaemonProcess, client: Vehicle, config: Path, nonsense: Nonsense, seconds: float) -> Row:
    """Fuzz for so long [s]; what was found."""
    rng, whole = nonsense.rng, config.read_text(encoding="utf-8")  # noqa: ASYNC240  # nothing else runs here yet
    stranger, counted = Stranger(daemon.endpoint), await _refused_setpoints(client)
    root = secret = ""
    silences, files, warm = 0, 0, (0.0, 0)
    began, next_look, next_file, next_line = time.monotonic(), 0.0, 0.0, 10.0
    while (elapsed := time.monotonic() - began) < seconds:
        if elapsed >= next_look:
            next_look = elapsed + LOOK_PERIOD
            root, secret = await _lease(client) or (root, secret)
            silences += await is_silent(client)
        if elapsed >= next_file:
            next_file = elapsed + FILE_PERIOD
            config.write_text(nonsense.file(whole), encoding="utf-8")  # noqa: ASYNC240
            daemon.send_signal(signal.SIGUSR1)
            files += 1
        if not warm[1] and elapsed > WARM * seconds:
            warm = daemon.resident_mb(), daemon.descriptors()
        if rng.random() < 0.5 and root:
            suffix = rng.choice(SETPOINTS).suffix
            payload = nonsense.payload(("epoch", "sequence", "ttl"))[:LONGEST]
            stranger.put(root, suffix, payload, sign(secret, suffix, payload) if rng.random() < 0.5 else bytes(32))
        elif len(stranger.open) < IN_FLIGHT:
            stranger.ask(*nonsense.request())
        if elapsed >= next_line:
            next_line = elapsed + 10.0
            print(f"{elapsed:4.0f} s: {dict(stranger.asked)}, {daemon.resident_mb():.1f} MiB", file=sys.stderr)
        await asyncio.sleep(PERIOD)
    config.write_text(whole, encoding="utf-8")  # noqa: ASYNC240
    with suppress(MkError):  # the procedure that runs ends, and what is still to be answered is
        await client.command("do", "cancel", {})
    with suppress(TimeoutError):
        await wait_until(lambda: not stranger.open, LAST_ANSWERS, 0.1)
    await asyncio.sleep(LOOK_PERIOD)  # `control/status` comes twice a second
    found = {
        "queries": stranger.asked["queries"],
        "setpoints": stranger.asked["setpoints"],
        "files": files,
        "refused": stranger.refused,
        "unnamed": stranger.unnamed,
        "unanswered": [*stranger.unanswered, *stranger.open.values()],
        "uncounted": stranger.asked["setpoints"] - (await _refused_setpoints(client) - counted),
        "unread": files - stranger.read_files,
        "silences": silences,
        "growth_mb": round(daemon.resident_mb() - warm[0], 1),
        "more_descriptors": daemon.descriptors() - warm[1],
    }
    stranger.session.close()  # type: ignore[no-untyped-call]
    return found


async def _lease(client: Vehicle) -> tuple[str, str] | None:
    """Take the lease from whoever has it; the root of setpoints and the secret, or None where it is refused."""
    answer = await client.command("do", "lease", {"action": "take", "holder": "fuzz", "force": True, "ttl": 60.0})
    reply = answer.reply
    return None if not reply else (str(reply["setpoint_root"]), str(reply["secret"]))


async def _refused_setpoints(client: Vehicle) -> int:
    status = await client.control.status.latest()
    return 0 if status is None else status.value.refused


async def is_silent(client: Vehicle) -> bool:
    """Whether the daemon's `link/health` is too old, or not there; one that says that it is busy lives."""
    try:
        health = await client.link.health.latest()
    except MkError as error:
        if getattr(error, "token", None) == Token.BUSY:
            return False
        print(f"an honest client: {type(error).__name__}: {error}", file=sys.stderr)
        return True
    return health is None or health.age > LONGEST_SILENCE


async def ended(daemon: DaemonProcess) -> Row:
    """End a daemon in order; its `exit_code`, and the `tracebacks` that it wrote."""
    exit_code = await daemon.end(signal.SIGTERM)
    return {"exit_code": exit_code, "tracebacks": tracebacks(daemon.errors)}


def tracebacks(errors: str) -> int:
    """How many tracebacks a program wrote; the last words with one are shown."""
    count = errors.count("Traceback")
    if count:
        print(errors[-5000:], file=sys.stderr)
    return count


def holds(row: Row, limits: Mapping[str, float] = LIMITS) -> bool:
    """Whether nothing went wrong, and nothing grew more than it may."""
    return not any(row.get(name) for name in WRONG) and all(row[name] <= most for name, most in limits.items())


async def fuzz(seconds: float, seed: int) -> Row:
    """Run a daemon before simulated boards and fuzz it for so long [s].

    Returns:
        How many `queries`, `setpoints` and `files`; refusals by token, `unnamed` ones without a known token or a
        reason; queries `unanswered`; setpoints refused that `control/status` did not count (`uncounted`); files
        without a word in the log (`unread`); `silences`, looks at which the link's health was too old; see `LIMITS`
        and `ended`; `holds`.

    Raises:
        TimeoutError: the daemon did not come up.
        MkError: it does not answer an honest client.
    """
    async with flown(observed(seed, nc="0.24"), on_tcp=True) as one:
        found = await _fuzz(one.daemon, one.client, one.folder / "daemon.toml", Nonsense(seed), seconds)
        found |= await ended(one.daemon)
    return found | {"holds": holds(found)}

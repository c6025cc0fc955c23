"""Nonsense, drawn from a seed: values, payloads, requests and configuration files."""

from __future__ import annotations

import math
import random
from typing import Any, Final

import msgpack

from mkdaemon.protocol.wire import MESSAGES, Direction
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

"""`python -m lab hil --case control`: how a FlightCtrl's own firmware takes external control, and lets go of it.

On the bench, motors at rest: each layout of the stick frame is sent, and the firmware's memory says what became of it;
then the board is left alone, or asked for other things, and its memory says for how long it goes on with the sticks.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Final

from lab import tables
from lab.hil import eeprom
from lab.hil.build import built
from lab.hil.chip import Chip
from lab.hil.memory import control_of
from lab.hil.world import CHANNELS
from mkdaemon.protocol.flags import ControlConfig
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2
from mksim.boards.line import HOST_CHAR

BOOTED: Final = 8.0
STEP: Final = 1e-3
CYCLE: Final = 1e-6
"""Less than that does not move the processor on [s]."""
POLLING: Final = 0.5
"""Between two requests of one kind [s]."""
LONGEST: Final = 7.0
"""Longest that sticks are waited for to be dropped [s]."""
MARGIN: Final = 0.7
"""Sticks held so much longer than in silence are kept alive by what was asked [s]."""
REQUESTS: Final = {
    "a": b"\x03",
    "c": b"\x00",
    "d": b"\x00",
    "g": b"",
    "h": b"\xff\x00",
    "l": b"\x00",
    "n": b"",
    "p": b"",
    "q": b"\xff",
    "t": bytes(16),
    "v": b"",
    "z": b"\x01\x02",
}
"""What a program may ask for while a stick frame is held; the motor test is one of motors at rest."""
TOGETHER: Final = ("acdghlnpqtvz", "cgnqvz")
"""Asked for in turn first: where the sticks are dropped in time, none of them keeps them alive."""
VALUES: Final = {"pitch": 11, "roll": -7, "yaw": 5, "throttle": 100, "frame": 9}


@dataclass(slots=True)
class Found:
    """What a firmware does with stick frames.

    Attributes:
        version: its reply names it.
        layouts: what its memory holds after a frame of each layout: pitch, roll, yaw, throttle, valid; None for
            nothing that was sent.
        confirmed: time to the confirmation [s].
        held: how long sticks were held in silence [s].
        kept_alive_by: letters that keep them alive.
        not_by: letters that do not.
    """

    version: tuple[int, int, str] = (0, 0, "")
    layouts: dict[str, tuple[int, int, int, int, bool] | None] = field(default_factory=dict)
    confirmed: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)
    kept_alive_by: str = ""
    not_by: str = ""


class Bench:
    """A FlightCtrl, and what it says."""

    def __init__(self, name: str) -> None:
        """Power it up, and wait until it listens.

        Args:
            name: of a firmware that was built.
        """
        firmware = built(name)
        self.chip = Chip(firmware, eeprom.content(firmware), seed=1)
        self._layout = control_of(firmware)
        self._decoder, self._left = FrameDecoder(), list[tuple[float, int]]()
        self.chip.lines.analog[:] = eeprom.QUIET_LEVELS
        self.chip.lines.channels, self.chip.lines.is_receiving = CHANNELS, 1
        self.run(BOOTED)

    def send(self, data: bytes) -> None:
        """Put characters on the line."""
        now = self._left[-1][0] if self._left else self.chip.now
        self._left += [(now + k * HOST_CHAR, byte) for k, byte in enumerate(data, 1)]

    def run(self, seconds: float) -> list[tuple[float, Frame]]:
        """Run on; the frames that came, with the times of their last characters [s]."""
        end, heard = self.chip.now + seconds, []
        while end - self.chip.now > CYCLE:
            until = min(end, self.chip.now + STEP)
            while self._left and self._left[0][0] <= until:
                at, byte = self._left.pop(0)
                self.chip.run(max(0.0, at - self.chip.now))
                self.chip.receive(byte)
            self.chip.run(max(0.0, until - self.chip.now))
            for at, byte in self.chip.read():
                heard += [(at, found) for found in self._decoder.feed(bytes((byte,))) if isinstance(found, Frame)]
        return heard

    @property
    def held(self) -> tuple[int, int, int, int, bool]:
        """External control as its memory holds it."""
        return self._layout.held(self.chip)

    def until_dropped(self, meanwhile: Callable[[float], None], longest: float) -> float | None:
        """How long sticks are held from now on [s]; None for longer."""
        began = self.chip.now
        while self.held[4]:
            if self.chip.now - began > longest:
                return None
            meanwhile(self.chip.now)
            self.run(5 * STEP)
        return self.chip.now - began


Kind = type[ExternControlV1] | type[ExternControlV2]


def control_frame(kind: Kind, *, valid: bool = True) -> bytes:
    """A stick frame of a layout, with a value of its own for each stick."""
    config = ControlConfig.VALID if valid else ControlConfig.NONE
    return kind(**VALUES, config=config).to_frame()


def measure(name: str, tries: int) -> Found:
    """Look at a firmware.

    Args:
        name: of one that was built.
        tries: silences.
    """
    bench, found = Bench(name), Found()
    bench.send(b"\r\r" + encode_frame(1, "v"))
    for _, frame in bench.run(0.3):
        if frame.id == "V":
            major, minor, patch = frame.payload[0], frame.payload[1], frame.payload[4]
            found.version = major, minor, chr(ord("a") + patch)
    right: Kind | None = None
    for kind in (ExternControlV1, ExternControlV2):
        bench.send(control_frame(kind))
        sent = bench.chip.now + len(control_frame(kind)) * HOST_CHAR
        confirms = [at - sent for at, frame in bench.run(0.3) if frame.id == "B"]
        held = bench.held
        is_read = held[:3] == (VALUES["pitch"], VALUES["roll"], VALUES["yaw"]) and held[4]
        found.layouts[kind.__name__] = held if held[4] else None
        if is_read:
            right = kind
            found.confirmed += confirms
        bench.send(control_frame(kind, valid=False))
        bench.run(0.3)
    if right is None:
        return found
    whole = control_frame(right)
    for count in range(tries):
        bench.run(0.0137 * count)
        bench.send(whole)
        bench.run(len(whole) * HOST_CHAR + 0.02)
        dropped = bench.until_dropped(lambda now: None, LONGEST)
        if dropped is not None:
            found.held.append(dropped + 0.02)
    silent = median(found.held) if found.held else LONGEST
    for letters in (*TOGETHER, *REQUESTS):
        asked = [letter for letter in letters if letter not in found.not_by]
        if asked and not _keeps(bench, right, asked, silent + MARGIN):
            found.not_by += "".join(asked)
        elif len(letters) == 1 and asked:
            found.kept_alive_by += letters
    return found


def _keeps(bench: Bench, kind: Kind, letters: Sequence[str], longest: float) -> bool:
    """Hold sticks, and ask for some things again and again: whether they are held longer than in silence."""
    whole = control_frame(kind)
    bench.send(whole)
    bench.run(len(whole) * HOST_CHAR + 0.05)
    due, turn = bench.chip.now, itertools.cycle(letters)

    def ask(now: float) -> None:
        nonlocal due
        if now >= due:
            due = now + POLLING / len(letters)
            letter = next(turn)
            bench.send(encode_frame(1, letter, REQUESTS[letter]))

    is_kept = bench.until_dropped(ask, longest) is None
    bench.send(control_frame(kind, valid=False))
    bench.run(0.5)
    return is_kept


_STICKS: Final = (VALUES["pitch"], VALUES["roll"], VALUES["yaw"])


def show(names: list[str], tries: int, *, as_json: bool) -> int:
    """Measure every firmware, and show it; exit code 1 where one takes no stick frame.

    Args:
        names: of firmware that was built.
        tries: silences of each.
        as_json: print JSON in place of a table.
    """
    return tables.show([row_of(name, measure(name, tries)) for name in names], ("firmware",), as_json=as_json)


def spread(values: list[float]) -> tuple[float, ...]:
    """Least, median and most; nothing of nothing."""
    return (min(values), median(values), max(values)) if values else ()


def row_of(name: str, found: Found) -> dict[str, Any]:
    """A firmware's row."""
    major, minor, patch = found.version
    return {
        "firmware": name,
        "version": f"{major}.{minor:02d}{patch}",
        "layouts": [kind for kind, held in found.layouts.items() if held and held[:3] == _STICKS],
        "confirmed_s": [round(at, 4) for at in found.confirmed],
        "held_s": [round(value, 3) for value in spread(found.held)],
        "kept_alive_by": found.kept_alive_by,
        "not_by": found.not_by,
        "holds": bool(found.held),
    }

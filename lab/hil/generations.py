"""`python -m lab hil --case control`: how a FlightCtrl's own firmware takes external control, and lets go of it.

On the bench, motors at rest: each layout of the stick frame is sent, and the firmware's memory says what became of it;
then the board is left alone, or asked for other things, and its memory says for how long it goes on with the sticks.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from statistics import median
from typing import Final

from lab import tables
from lab.campaign import Row
from lab.hil.build import built
from lab.hil.chip import QUIET_LEVELS, Chip, Held, control_of, eeprom_of
from lab.hil.world import CHANNELS
from mkdaemon.protocol.flags import ControlConfig
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2
from mksim.boards.line import HOST_CHAR

BOOTED: Final = 8.0
STEP: Final = 5e-3
"""Between two looks at what it holds [s]."""
ANSWER: Final = 0.3
"""Waited for an answer [s]."""
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
Kind = type[ExternControlV1] | type[ExternControlV2]


def control_frame(kind: Kind, *, valid: bool = True) -> bytes:
    """A stick frame of a layout, with a value of its own for each stick."""
    return kind(**VALUES, config=ControlConfig.VALID if valid else ControlConfig.NONE).to_frame()


class Bench:
    """A FlightCtrl that was built, powered up and listening, and what it answers."""

    def __init__(self, name: str) -> None:
        firmware = built(name)
        self.chip = Chip(firmware, eeprom_of(firmware), seed=1)
        self._layout = control_of(firmware)
        self._decoder = FrameDecoder()
        self.chip.lines.analog[:] = QUIET_LEVELS
        self.chip.lines.channels, self.chip.lines.is_receiving = CHANNELS, 1
        self.run(BOOTED)

    def send(self, data: bytes, wait: float = 0.0) -> list[tuple[float, Frame]]:
        """Put characters on the line, and run on until they have left, and longer [s]; see `run`."""
        inbox = self.chip.inbox
        now = inbox[-1][0] if inbox else self.chip.now
        inbox.extend((now + k * HOST_CHAR, byte) for k, byte in enumerate(data, 1))
        return self.run(wait)

    def run(self, seconds: float) -> list[tuple[float, Frame]]:
        """Run on; the frames that came, with the times of their last characters [s]."""
        self.chip.run_to(self.chip.now + seconds)
        answers = [(at, self._decoder.feed(bytes((byte,)))) for at, byte in self.chip.read()]
        return [(at, found) for at, each in answers for found in each if isinstance(found, Frame)]

    @property
    def held(self) -> Held:
        """External control as its memory holds it."""
        return self.chip.held(self._layout)

    def until_dropped(self, longest: float, meanwhile: Callable[[float], None] = lambda now: None) -> float | None:
        """How long sticks are held from now on [s]; None for longer."""
        began = self.chip.now
        while self.held[4]:
            if self.chip.now - began > longest:
                return None
            meanwhile(self.chip.now)
            self.run(STEP)
        return self.chip.now - began


def measure(name: str, tries: int) -> Row:
    """What a firmware that was built does with stick frames, with so many silences.

    Returns:
        Its `version`; the `layouts` that it takes as sent; `confirmed_s`, time to the confirmation [s]; `held_s`,
        least, median and most that sticks were held in silence [s]; `kept_alive_by` and `not_by`, letters of requests
        that keep them alive and that do not; `holds`: it takes stick frames.
    """
    bench, layouts, confirmed = Bench(name), list[Kind](), list[float]()
    answers = bench.send(b"\r\r" + encode_frame(1, "v"), ANSWER)
    versions = [frame.payload for _, frame in answers if frame.id == "V"]
    for kind in (ExternControlV1, ExternControlV2):
        whole = control_frame(kind)
        answers = bench.send(whole, ANSWER)
        sent = bench.chip.now - ANSWER + len(whole) * HOST_CHAR
        if bench.held[:3] == (VALUES["pitch"], VALUES["roll"], VALUES["yaw"]) and bench.held[4]:
            layouts.append(kind)
            confirmed += [at - sent for at, frame in answers if frame.id == "B"]
        bench.send(control_frame(kind, valid=False), ANSWER)
    held = _silences(bench, control_frame(layouts[-1]), tries) if layouts else []
    silent, keeping, others = median(held) if held else LONGEST, "", ""
    for letters in (*TOGETHER, *REQUESTS) if layouts else ():
        asked = "".join(letter for letter in letters if letter not in others)
        if asked and not _keeps(bench, layouts[-1], asked, silent + MARGIN):
            others += asked
        elif len(letters) == 1:
            keeping += asked
    return {
        "firmware": name,
        "version": version_of(versions[0]) if versions else "",
        "layouts": [kind.__name__ for kind in layouts],
        "confirmed_s": [round(at, 4) for at in confirmed],
        "held_s": [round(value, 3) for value in (min(held), silent, max(held))] if held else [],
        "kept_alive_by": keeping,
        "not_by": others,
        "holds": bool(held),
    }


def version_of(payload: bytes) -> str:
    """The release in a version reply, for example `2.12a`."""
    return f"{payload[0]}.{payload[1]:02d}{chr(ord('a') + payload[4])}"


def _silences(bench: Bench, whole: bytes, tries: int) -> list[float]:
    """How long sticks are held in silence [s]."""
    found = []
    for count in range(tries):
        bench.run(0.0137 * count)
        bench.send(whole, len(whole) * HOST_CHAR + 0.02)
        dropped = bench.until_dropped(LONGEST)
        found += [] if dropped is None else [dropped + 0.02]
    return found


def _keeps(bench: Bench, kind: Kind, letters: Sequence[str], longest: float) -> bool:
    """Hold sticks, and ask for some things again and again: whether they are held longer than in silence."""
    whole = control_frame(kind)
    bench.send(whole, len(whole) * HOST_CHAR + 0.05)
    due, turn = bench.chip.now, itertools.cycle(letters)

    def ask(now: float) -> None:
        nonlocal due
        if now >= due:
            due = now + POLLING / len(letters)
            letter = next(turn)
            bench.send(encode_frame(1, letter, REQUESTS[letter]))

    is_kept = bench.until_dropped(longest, ask) is None
    bench.send(control_frame(kind, valid=False), 0.5)
    return is_kept


def show(names: Sequence[str], tries: int, *, as_json: bool) -> int:
    """Measure every firmware that was built, and show it; exit code 1 where one takes no stick frame."""
    return tables.show([measure(name, tries) for name in names], ("firmware",), as_json=as_json)

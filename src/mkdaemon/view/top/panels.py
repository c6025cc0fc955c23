"""What the terminal view shows of a vehicle: which facts of its picture, and where they stand on 80 x 24. Pure.

A colour only repeats what a word says. A line that does not fit goes on below, so that a remedy is not cut.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from textwrap import wrap
from typing import Final

from mkdaemon.reading import EventLine, Fact, Picture, Reading, line_of
from mkdaemon.reading.facts import age_words
from mkdaemon.reading.known import KEYS as VALUES
from mkdaemon.spelling import on_one_line
from mkdaemon.telemetry import tone
from mkdaemon.telemetry.control import ControlStatus
from mkdaemon.telemetry.link import FATES
from mkdaemon.telemetry.state import Attitude

COLUMNS: Final = 80
ROWS: Final = 24
EVENTS: Final = 5
"""Events that are kept."""
_SHOWN: Final = 3
"""Least rows of events."""
_LEFT: Final = 23
"""Columns of the horizon."""
_NAME: Final = 14
"""Columns of a name."""
_SHORT: Final = 10
"""Columns of a name beside the horizon."""
_HEADLINE: Final = 4
"""Most rows of the worst that is known."""
DEGREES_A_ROW: Final = 6.0
"""Scale: pitch of one row [deg]."""
ROW_OF_COLUMNS: Final = 2.0
"""A letter is about twice as high as wide."""
FLAT: Final = math.radians(20.0)
"""Up to this roll the line is drawn by `-` [rad]."""
SKY, GROUND = " ", ":"
BESIDE: Final = ("height", "battery", "pose", "attitude", "speed", "gps", "receiver")
"""Facts beside the horizon, one row each."""
BELOW: Final = ("control", "manoeuvre", "hands", "flight", "link", "latency", "streams")
"""Facts below it."""
KEYS: Final = (*VALUES, "event/command", "event/mode", "event/failsafe", "event/log")
"""What is watched."""


class RowStyle(StrEnum):
    """How a part of a row looks; beside it a word always says the same."""

    PLAIN = ""
    TITLE = "bold"
    DIM = "dim"
    GOOD = "green"
    WARN = "bold yellow"
    BAD = "bold red"
    BAR = "reverse"


TONES: Final = {
    tone.Tone.NOTE: RowStyle.PLAIN,
    tone.Tone.OK: RowStyle.GOOD,
    tone.Tone.WARN: RowStyle.WARN,
    tone.Tone.BAD: RowStyle.BAD,
    tone.Tone.UNKNOWN: RowStyle.DIM,
}
"""How a state looks."""
Part = tuple[str, RowStyle]
Row = list[Part]


class VehicleBoard:
    """Last values and events of one vehicle.

    Attributes:
        vehicle: its name.
        fleet: names of all vehicles.
        notice: what came of the last key; empty for nothing.
    """

    def __init__(self, vehicle: str) -> None:
        self.vehicle = vehicle
        self.fleet: Sequence[str] = ()
        self.notice = ""
        self._reading = Reading()
        self._events: deque[tuple[float, EventLine]] = deque(maxlen=EVENTS)

    def take(self, suffix: str, value: object, at: float) -> None:
        """Note a value.

        Args:
            suffix: its key.
            value: as its key carries it.
            at: when it was true, on the viewer's clock [s].
        """
        line = line_of(value)
        if line is None:
            self._reading.take(suffix, value, at)
        elif not line.is_routine:
            self._events.append((at, line))

    def lease_holder(self) -> str | None:
        """Holder of the lease; None if there is none or it is not known."""
        status = self._reading.at(0.0).last("control/status", ControlStatus)
        lease = None if status is None else status.value.lease
        return None if lease is None else on_one_line(lease.holder)

    def rows(self, now: float) -> list[Row]:
        """The whole screen, `ROWS` rows of at most `COLUMNS` columns."""
        picture = self._reading.at(now)
        body = [*self._headline(picture), *_horizon(picture), *_below(picture)]
        body = body[: ROWS - 1 - min(_SHOWN, len(self._events))]
        room = ROWS - 1 - len(body)
        events = [row for at, line in self._events for row in _event(line, now - at)]
        body += events[-room:] if room else []
        body += [[]] * (ROWS - 1 - len(body))
        return [clipped(row, COLUMNS) for row in (*body, self._foot())]

    def _headline(self, picture: Picture) -> Iterator[Row]:
        """The worst first; what else is wrong follows while there is room."""
        head: Row = [(f" {on_one_line(self.vehicle)} ", RowStyle.BAR), (" ", RowStyle.PLAIN)]
        room = max(COLUMNS - sum(len(text) for text, _ in head), 1)
        worst = [(picture.headline, picture.tone), *((alarm.text, alarm.tone) for alarm in picture.alarms[1:])]
        lines = [(line, TONES[how]) for words, how in worst for line in wrap(words, room)][:_HEADLINE]
        others = " ".join(on_one_line(name) for name in self.fleet if name != self.vehicle)
        fleet: Row = [(f"   also: {others}", RowStyle.DIM)] if others else []
        for place, line in enumerate(lines):
            yield [*head, line, *fleet] if place == 0 else [(" " * (COLUMNS - room), RowStyle.PLAIN), line]

    def _foot(self) -> Row:
        keys = " q quit   r release   l land   v vehicle"
        return [(keys, RowStyle.BAR), (f"  {on_one_line(self.notice)}" if self.notice else "", RowStyle.TITLE)]


def _horizon(picture: Picture) -> Iterator[Row]:
    """The horizon, which is drawn only while it is the present one, and numbers beside it."""
    attitude = picture.fresh("state/attitude", Attitude)
    if attitude is None:
        drawn = [" " * _LEFT] * len(BESIDE)
        drawn[len(BESIDE) // 2] = f"{'no present attitude':^{_LEFT}}"
    else:
        drawn = horizon(attitude.roll, attitude.pitch, _LEFT, len(BESIDE))
    for row, word in zip(drawn, BESIDE, strict=True):
        yield [(row, RowStyle.PLAIN), (" ", RowStyle.PLAIN), *_one(picture.fact(word), _SHORT)]


def _one(fact: Fact, width: int) -> Row:
    return [(f"{fact.name:<{width}}", RowStyle.TITLE), (fact.aged, TONES[fact.tone])]


def _below(picture: Picture) -> Iterator[Row]:
    """The lease, the line, the cameras, what became of what was sent."""
    cameras = [fact for fact in picture.facts if fact.id.startswith(("camera", "eye", "sight"))]
    for fact in (*map(picture.fact, BELOW), *cameras, *map(picture.fact, FATES)):
        yield from _wrapped(fact.name, fact.aged, TONES[fact.tone])


def _wrapped(name: str, text: str, looks: RowStyle) -> Iterator[Row]:
    """A row that goes on below its text."""
    for place, line in enumerate(wrap(text, COLUMNS - _NAME) or [""]):
        yield [(f"{'' if place else name:<{_NAME}}", RowStyle.TITLE), (line, looks)]


def _event(line: EventLine, age: float) -> Iterator[Row]:
    """An event, and what to do about it."""
    words = f"{line.text} {line.fix}".strip()
    return _wrapped(f"{age_words(max(age, 0.0)):>8} ago", words, TONES[line.tone])


def clipped(row: Iterable[Part], columns: int) -> Row:
    """The same row without empty parts, and cut at a width; a cut ends with `>`."""
    found: Row = []
    room = columns
    for text, looks in row:
        if not text:
            continue
        if len(text) > room:
            found.append((f"{text[: room - 1]}>" if room else "", looks))
            break
        found.append((text, looks))
        room -= len(text)
    return found


def horizon(roll: float, pitch: float, columns: int, rows: int) -> list[str]:
    """Draw what a pilot sees: sky is blank, ground `:`, and between them a line.

    Args:
        roll: right side down positive [rad]: the right end of the line is higher then.
        pitch: nose down positive [rad]: the line moves up.
        columns: width, odd.
        rows: height, odd.

    Returns:
        Rows from the top; `==o==` in the middle is the aircraft.
    """
    edge = "-" if abs(math.remainder(roll, math.pi)) < FLAT else "/" if math.tan(roll) > 0 else "\\"
    found = []
    for row in range(rows):
        up = rows // 2 - row
        letters = []
        for column in range(columns):
            right = (column - columns // 2) / ROW_OF_COLUMNS
            over = (up * math.cos(roll) - right * math.sin(roll)) - math.degrees(pitch) / DEGREES_A_ROW
            letters.append(edge if abs(over) <= 0.5 else SKY if over > 0 else GROUND)
        found.append("".join(letters))
    middle, place = rows // 2, columns // 2 - 2
    found[middle] = f"{found[middle][:place]}==o=={found[middle][place + 5 :]}"
    return found

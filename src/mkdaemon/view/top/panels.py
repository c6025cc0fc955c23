"""What the terminal view says of a vehicle: last values, their age, and the rows of 80 columns made of them. Pure.

What is stale says so in words, with its age; a colour only repeats what a word says. What others wrote is spelled.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from textwrap import wrap
from typing import Any, Final

from mkdaemon.client.summary import SEEN, WEAK_CELL
from mkdaemon.client.verdict import LINK_WORDS
from mkdaemon.spelling import on_one_line
from mkdaemon.telemetry import control
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import FATES, fates_of
from mkdaemon.view.top.horizon import horizon

Fields = Mapping[str, Any]

COLUMNS: Final = 80
ROWS: Final = 24
EVENTS: Final = 5
"""Rows of events."""
EYES: Final = 3
"""Rows for cameras and their target."""
_LEFT: Final = 25
"""Columns of the horizon."""
_HIGH: Final = 7
"""Rows of the horizon."""
_LINK: Final = 2 + len(FATES)
"""Rows of the link."""
KEYS: Final = (
    "health",
    "link/state",
    "link/health",
    "control/status",
    "state/*",
    "vision/*/stats",
    "vision/*/pose",
    "event/command",
    "event/mode",
    "event/failsafe",
    "event/log",
)
"""What is watched."""
_TITLE: Final = max(map(len, FATES.values()))
"""Columns of what is counted."""
STALE_AFTER: Final = {"state/attitude": 1.0, "link/health": 1.0}
"""Age from which a value is stale [s]; others after `STALE`."""
STALE: Final = 3.0
"""The same for values that come once a second [s]."""


class Tone(StrEnum):
    """How a part of a row looks; beside it a word always says the same."""

    PLAIN = ""
    TITLE = "bold"
    DIM = "dim"
    GOOD = "green"
    WARN = "bold yellow"
    BAD = "bold red"
    BAR = "reverse"


TONES: Final = {
    control.Tone.NOTE: Tone.PLAIN,
    control.Tone.OK: Tone.GOOD,
    control.Tone.WARN: Tone.WARN,
    control.Tone.BAD: Tone.BAD,
}
"""How a state looks."""
Part = tuple[str, Tone]
Row = list[Part]


@dataclass(frozen=True, slots=True)
class Value:
    """A last value.

    Attributes:
        fields: as it came.
        at: when it was true, on the viewer's clock [s].
    """

    fields: Fields
    at: float


def phase_part(word: str) -> Part:
    """A phase of authority; a word that this version does not know is shown like a warning."""
    tone = next((TONES[phase.tone] for phase in Phase if phase == word), Tone.WARN)
    return word if tone is Tone.PLAIN else on_one_line(word).upper(), tone


class Board:
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
        self._known: dict[str, Value] = {}
        self._events: deque[tuple[float, str, Tone]] = deque(maxlen=EVENTS)
        self._received_at: float | None = None

    def take(self, suffix: str, fields: Fields, now: float) -> None:
        """Note a value.

        Args:
            suffix: its key.
            fields: as it came; one that was asked for has its `age` [s].
            now: on the viewer's clock [s].
        """
        age = fields.get("age")
        at = now if age is None else now - float(age)
        self._received_at = at if self._received_at is None else max(self._received_at, at)
        if suffix.startswith("event/"):
            if (event := _event(suffix, fields)) is not None:
                self._events.append((at, *event))
            return
        self._known[suffix] = Value(fields, at)

    def lease_holder(self) -> str | None:
        """Who holds the lease; None for nobody, or where it is not known."""
        status = self._known.get("control/status")
        lease = None if status is None else status.fields.get("lease")
        return None if lease is None else on_one_line(lease["holder"])

    def rows(self, now: float) -> list[Row]:
        """The whole screen, `ROWS` rows of at most `COLUMNS` columns."""
        left = self._horizon(now)
        right = [*self._numbers(now)]
        right += [[]] * (_HIGH - len(right))
        beside = [[*a, (" ", Tone.PLAIN), *b] for a, b in zip(left, right, strict=True)]
        found = [
            self._title(now),
            *beside,
            *_filled(self._link(now), _LINK),
            *_filled(self._eyes(now), EYES),
            *_filled(self._authority(now), 2),
            *_filled(self._shown_events(now), EVENTS),
            self._foot(now),
        ]
        return [clipped(row, COLUMNS) for row in found]

    def _title(self, now: float) -> Row:
        value = self._known.get("health")
        if value is None:
            state: Row = [("not heard yet", Tone.WARN)]
        elif (silence := now - (self._received_at or now)) > STALE:
            state = [(f"NOTHING HEARD FOR {age_words(silence)}", Tone.BAD)]
        else:
            fields = value.fields
            motors = {True: "motors RUN", False: "motors off", None: "motors unknown"}[fields["motors_running"]]
            is_alive = fields["is_alive"]
            state = [("alive" if is_alive else "NOT ALIVE", Tone.GOOD if is_alive else Tone.BAD)]
            state.append((f", {motors}", Tone.WARN if fields["motors_running"] else Tone.PLAIN))
            if fields["error"]:
                state.append((f", ERROR {on_one_line(fields['error'])}", Tone.BAD))
            if fields["read_only"]:
                state.append((", READ ONLY", Tone.WARN))
        if worst := next(self._worst(now), ""):
            is_longer = len(self._trouble(now)) > 1
            state = [(worst, Tone.BAD)] if is_longer else [(worst, Tone.BAD), (", ", Tone.PLAIN), *state]
        others = [name for name in self.fleet if name != self.vehicle]
        fleet = f"   also: {' '.join(on_one_line(name) for name in others)}" if others else ""
        return [(f" {on_one_line(self.vehicle)} ", Tone.BAR), (" ", Tone.PLAIN), *state, (fleet, Tone.DIM)]

    def _worst(self, now: float) -> Iterator[str]:
        """What is wrong, the worst first; silence, the boards' own error and stale values are said elsewhere."""
        known = {key: value.fields for key, value in self._known.items() if not self._stale(key, now)}
        if known.get("state/flight", {}).get("emergency_landing"):
            yield "EMERGENCY LANDING"
        yield from self._trouble(now)[:1]
        if known.get("state/battery", {}).get("is_low"):
            yield "BATTERY LOW"
        condition = known.get("link/state", {}).get("condition")
        yield from (words for bad, words in LINK_WORDS.items() if bad == condition and not bad.is_usable)

    def _trouble(self, now: float) -> list[str]:
        """The chain of causes, cut for the first row and for the rows of the control; nothing without trouble."""
        value = self._known.get("control/status")
        if value is None or self._stale("control/status", now):
            return []
        room = COLUMNS - len(on_one_line(self.vehicle)) - 3
        words = on_one_line(value.fields.get("trouble") or "")
        first, *rest = wrap(words, room) or [""]
        return [first, *wrap(" ".join(rest), COLUMNS - 9)] if first else []

    def _horizon(self, now: float) -> list[Row]:
        value = self._known.get("state/attitude")
        if value is None:
            drawn = [" " * _LEFT] * _HIGH
            drawn[_HIGH // 2] = f"{'no attitude yet':^{_LEFT}}"
        else:
            drawn = horizon(value.fields["roll"], value.fields["pitch"], _LEFT, _HIGH)
        stale = self._stale("state/attitude", now)
        if stale:
            drawn[_HIGH // 2 + 1] = f"{stale:^{_LEFT}}"
        return [[(row, Tone.DIM if stale else Tone.PLAIN)] for row in drawn]

    def _numbers(self, now: float) -> Iterator[Row]:
        for name, key, words in _NUMBERS:
            value = self._known.get(key)
            health = self._known.get("health")
            if value is None:
                yield [(f"{name:<9}", Tone.TITLE), ("unknown", Tone.DIM)]
                continue
            text, tone = words(value.fields, {} if health is None else health.fields)
            yield [*self._head(name, key, now), (text, Tone.DIM if self._stale(key, now) else tone)]

    def _link(self, now: float) -> Iterator[Row]:
        value, health = self._known.get("link/state"), self._known.get("link/health")
        if value is None:
            yield [("link     ", Tone.TITLE), ("unknown", Tone.DIM)]
            return
        condition = value.fields["condition"]
        tone = {"up": Tone.GOOD, "degraded": Tone.WARN}.get(condition, Tone.BAD)
        word = condition if condition == "up" else condition.upper()
        yield [("link     ", Tone.TITLE), (word, tone), (f": {on_one_line(value.fields['reason'])}", Tone.PLAIN)]
        if health is None:
            return
        echo, kinds = health.fields["echo"], health.fields["kinds"]
        late = [on_one_line(kind["key"]) for kind in kinds if kind["is_stale"]]
        trips = "no answer yet" if echo["p50_ms"] is None else f"{echo['p50_ms']:.1f} ms, 99 % {echo['p99_ms']:.1f} ms"
        row: Row = [(f"round trip {trips}", Tone.PLAIN), (f", STALE: {' '.join(late)}" if late else "", Tone.WARN)]
        yield [*self._head("", "link/health", now), *row]
        for title, fates in fates_of(health.fields).items():
            yield [(f"{title:<{_TITLE}} ", Tone.TITLE), (fates.words, Tone.PLAIN)]

    def _eyes(self, now: float) -> Iterator[Row]:
        roots = sorted(key.rpartition("/")[0] for key in self._known if key.endswith("/stats"))
        if not roots:
            yield [("eyes     ", Tone.TITLE), ("no camera", Tone.DIM)]
        for root in roots:
            stats = self._known[f"{root}/stats"].fields
            name = on_one_line(stats["camera"])
            head = self._head("eyes", f"{root}/stats", now)
            if stats["state"] != "ok":
                words = f"{name} {stats['state'].upper()}: {on_one_line(stats['reason'])}"
                yield [*head, (words, Tone.BAD)]
                continue
            words = f"{name} {stats['fps']:.0f}/s, {100 * stats['posed']:.0f} % posed, {self._target(root, now)}"
            alarms = " ".join(alarm.upper() for alarm in stats["alarms"])
            tone = Tone.DIM if self._stale(f"{root}/stats", now) else Tone.PLAIN
            yield [*head, (words, tone), (alarms and f", {on_one_line(alarms)}", Tone.WARN)]

    def _target(self, root: str, now: float) -> str:
        pose = self._known.get(f"{root}/pose")
        if pose is None:
            return "no target seen"
        x, y, z = pose.fields["position_target"]
        name = on_one_line(pose.fields["target"])
        if now - pose.at > SEEN:
            return f"{name} NOT SEEN for {age_words(now - pose.at)}"
        return f"{name} x {x:+.2f} y {y:+.2f} z {z:.2f} m"

    def _authority(self, now: float) -> Iterator[Row]:
        value = self._known.get("control/status")
        if value is None:
            yield [("control  ", Tone.TITLE), ("unknown", Tone.DIM)]
            return
        fields = value.fields
        holder = self.lease_holder()
        phase = fields["phase"]
        flown = on_one_line(" ".join(word for word in (fields.get("manoeuvre"), fields.get("stage")) if word))
        words = f", {holder or 'nobody'} has the lease{f', {flown}' if flown else ''}"
        yield [*self._head("control", "control/status", now), phase_part(phase), (words, Tone.PLAIN)]
        for words in self._trouble(now)[1:]:
            yield [("         ", Tone.PLAIN), (words, Tone.BAD)]
        hands = fields.get("hands") and f"; the pilot {on_one_line(fields['hands'])}"
        yield [("         ", Tone.PLAIN), (f"{on_one_line(fields['reason'])}{hands or ''}", Tone.DIM)]

    def _shown_events(self, now: float) -> Iterator[Row]:
        for at, words, tone in self._events:
            yield [(f"{age_words(now - at):>6} ago  ", Tone.DIM), (words, tone)]

    def _foot(self, now: float) -> Row:
        keys = " q quit   r release   l land   v vehicle"
        return [(keys, Tone.BAR), (f"  {on_one_line(self.notice)}" if self.notice else "", Tone.TITLE)]

    def _head(self, name: str, key: str, now: float) -> Row:
        """Begin of a row: its name, and in front of everything that may be cut whether it is stale."""
        stale = self._stale(key, now)
        return [(f"{name:<9}", Tone.TITLE), (stale and f"{stale}: ", Tone.WARN)]

    def _stale(self, key: str, now: float) -> str:
        """What says that a value is stale; empty where it is not."""
        value = self._known.get(key)
        if value is None or now - value.at <= STALE_AFTER.get(key, STALE):
            return ""
        return f"STALE {age_words(now - value.at)}"


def clipped(row: Row, columns: int) -> Row:
    """The same row without empty parts, and cut at a width; a cut ends with `>`."""
    found: Row = []
    room = columns
    for text, tone in row:
        if not text:
            continue
        if len(text) > room:
            found.append((f"{text[: room - 1]}>" if room else "", tone))
            break
        found.append((text, tone))
        room -= len(text)
    return found


def _filled(rows: Iterator[Row], count: int) -> list[Row]:
    """So many rows: the first ones, and empty ones behind them."""
    found = list(rows)[:count]
    return found + [[]] * (count - len(found))


def age_words(seconds: float) -> str:
    """A length of time, short [s]."""
    return (
        f"{seconds:.0f} s"
        if seconds < 100
        else f"{seconds / 60:.0f} min"
        if seconds < 6000
        else f"{seconds / 3600:.0f} h"
    )


def _event(suffix: str, fields: Fields) -> tuple[str, Tone] | None:
    """An event in words; None for one that is not worth a row."""
    match suffix:
        case "event/failsafe":
            return f"FAILSAFE {fields['action']}: {on_one_line(fields['reason'])}", Tone.BAD
        case "event/mode":
            return f"{fields['before']} -> {fields['after']}: {on_one_line(fields['reason'])}", Tone.PLAIN
        case "event/log" if fields["level"] != "info":
            return f"{fields['level'].upper()} {on_one_line(fields['text'])}", Tone.WARN
        case "event/command" if fields.get("token"):
            words = f"REFUSED {on_one_line(fields['key'])}: {on_one_line(fields['reason'])} {fields.get('fix') or ''}"
            return on_one_line(words), Tone.WARN
    return None


def _attitude(fields: Fields, _: Fields) -> tuple[str, Tone]:
    roll, pitch, yaw = (math.degrees(fields[axis]) for axis in ("roll", "pitch", "yaw"))
    return f"roll {roll:+.1f} pitch {pitch:+.1f} heading {(90 - yaw) % 360:03.0f} deg", Tone.PLAIN


def _height(fields: Fields, _: Fields) -> tuple[str, Tone]:
    return f"{fields['above_start']:.2f} m above start", Tone.PLAIN


def is_low(battery: Fields, cells: int | None) -> bool:
    """Whether a battery of so many cells is low: the board says so, or its cells do."""
    return battery["is_low"] or (bool(cells) and battery["voltage"] / cells < WEAK_CELL)


def _battery(fields: Fields, health: Fields) -> tuple[str, Tone]:
    cells = health.get("battery_cells")
    low = is_low(fields, cells)
    words = f"{'LOW ' if low else ''}{fields['voltage']:.1f} V"
    if cells:
        words += f" ({cells} x {fields['voltage'] / cells:.2f})"
    if fields["current"] is not None:
        words += f", {fields['current']:.1f} A"
    if fields["used_mah"] is not None:
        words += f", {fields['used_mah']:.0f} mAh"
    return words, Tone.BAD if low else Tone.PLAIN


def _flight(fields: Fields, _: Fields) -> tuple[str, Tone]:
    words = [{True: "FLYING", False: "on the ground", None: "flying or not: unknown"}[fields["is_flying"]]]
    words.append(f"GPS {fields['gps_mode']}")
    if fields["flying_time"] is not None:
        words.append(f"{fields['flying_time']:.0f} s in the air")
    alarms = [name.replace("_", " ").upper() for name in ("emergency_landing", "rc_failsafe") if fields.get(name)]
    return ", ".join([*alarms, *words]), Tone.BAD if alarms else Tone.PLAIN


def _gps(fields: Fields, _: Fields) -> tuple[str, Tone]:
    satellites = "?" if fields["satellites"] is None else fields["satellites"]
    usable = "usable" if fields["is_usable"] else "NOT usable"
    return f"{satellites} satellites, position {fields['fix']}, {usable}", Tone.PLAIN


def _velocity(fields: Fields, _: Fields) -> tuple[str, Tone]:
    return f"{fields['ground_speed']:.1f} m/s over ground, {fields['climb_rate']:+.1f} up", Tone.PLAIN


def _pilot(fields: Fields, _: Fields) -> tuple[str, Tone]:
    if not fields["has_signal"]:
        return f"receiver {100 * fields['rc_quality']:.0f} %, NO SIGNAL", Tone.BAD
    return f"receiver {100 * fields['rc_quality']:.0f} %", Tone.PLAIN


_NUMBERS: Final[tuple[tuple[str, str, Callable[[Fields, Fields], tuple[str, Tone]]], ...]] = (
    ("attitude", "state/attitude", _attitude),
    ("flight", "state/flight", _flight),
    ("height", "state/altitude", _height),
    ("speed", "state/velocity", _velocity),
    ("battery", "state/battery", _battery),
    ("GPS", "state/gps", _gps),
    ("pilot", "state/pilot", _pilot),
)

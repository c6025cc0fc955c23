"""What the terminal view says of all vehicles: a row for each, of 80 columns. Pure.

What is stale, and who has gone, says so in words, with how long; a colour only repeats what a word says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Final

from mkdaemon.spelling import on_one_line
from mkdaemon.view.top.panels import (
    COLUMNS,
    STALE,
    Fields,
    Part,
    Row,
    Tone,
    Value,
    age_words,
    clipped,
    is_low,
    phase_part,
)

KEYS: Final = ("health", "control/status", "state/battery", "state/position")
"""What is watched of every vehicle; each comes once a second or more often."""
SIGHTING: Final = 10.0
"""A target that was seen longer ago says nothing of where the aircraft is [s]."""
_WIDTHS: Final = {"vehicle": 11, "who flies": 20, "link": 9, "battery": 13, "place": 15, "heard": 12}
"""Columns, their widths together `COLUMNS`."""


@dataclass
class _Vehicle:
    """One vehicle: its last values, when it was heard, and since when it has been gone."""

    known: dict[str, Value] = field(default_factory=dict)
    received_at: float | None = None
    gone_at: float | None = None


class FleetBoard:
    """Last values of every vehicle that was there since the beginning.

    Attributes:
        notice: what is wrong with the connection; empty for nothing.
    """

    def __init__(self) -> None:
        self.notice = ""
        self._vehicles: dict[str, _Vehicle] = {}

    def look(self, here: Iterable[str], now: float) -> None:
        """Note who is there: those whose daemon is alive.

        Args:
            here: their names.
            now: on the viewer's clock [s].
        """
        names = set(here)
        for name in names:
            self._vehicles.setdefault(name, _Vehicle()).gone_at = None
        for name, vehicle in self._vehicles.items():
            if name not in names and vehicle.gone_at is None:
                vehicle.gone_at = now

    def take(self, name: str, suffix: str, fields: Fields, now: float) -> None:
        """Note a value; one of a vehicle that is not there, or not yet, is left out.

        Args:
            name: of the vehicle.
            suffix: its key.
            fields: as it came.
            now: on the viewer's clock [s].
        """
        vehicle = self._vehicles.get(name)
        if vehicle is not None and vehicle.gone_at is None:
            vehicle.known[suffix] = Value(fields, now)
            vehicle.received_at = now

    def state(self, name: str, now: float) -> str:
        """Whether a vehicle is `unknown`, `gone`, `silent`, `stale` or `here`."""
        vehicle = self._vehicles.get(name)
        if vehicle is None:
            return "unknown"
        if vehicle.gone_at is not None:
            return "gone"
        if vehicle.received_at is None:
            return "silent"
        return "stale" if now - vehicle.received_at > STALE else "here"

    def rows(self, now: float, wall: float) -> list[Row]:
        """The screen: a title, a head, a row for each vehicle in order of their names, a foot.

        Args:
            now: on the viewer's clock [s].
            wall: the same moment [s; Unix time].
        """
        gone = sum(vehicle.gone_at is not None for vehicle in self._vehicles.values())
        count = len(self._vehicles) - gone
        title: Row = [(" fleet ", Tone.BAR), (f" {count} here", Tone.TITLE)]
        title.append((f", {gone} GONE" if gone else "", Tone.BAD))
        head = "".join(f"{name:<{width}}" for name, width in _WIDTHS.items())
        found = [title, [(head, Tone.TITLE)]]
        found += [self._row(name, self._vehicles[name], now, wall) for name in sorted(self._vehicles)]
        notice = f"  {on_one_line(self.notice)}" if self.notice else ""
        found.append([(" q quit", Tone.BAR), (notice, Tone.WARN)])
        return [clipped(row, COLUMNS) for row in found]

    def _row(self, name: str, vehicle: _Vehicle, now: float, wall: float) -> Row:
        shown = _cell((on_one_line(name), Tone.TITLE), _WIDTHS["vehicle"])
        if vehicle.gone_at is not None:
            since = datetime.fromtimestamp(wall - (now - vehicle.gone_at), UTC)
            words = f"GONE for {age_words(now - vehicle.gone_at)}, since {since:%H:%M:%S} UTC"
            last = [text for column in (_who, _battery) if (text := column(vehicle.known, now)[0]) != UNKNOWN[0]]
            return [shown, (words, Tone.BAD), (f"; last: {', '.join(last)}" if last else "", Tone.DIM)]
        if vehicle.received_at is None:
            return [shown, ("not heard yet", Tone.WARN)]
        age = now - vehicle.received_at
        is_stale = age > STALE
        received: Part = (f"STALE {age_words(age)}", Tone.BAD) if is_stale else (age_words(age), Tone.PLAIN)
        return [shown, *self._cells(vehicle.known, now, is_stale=is_stale), received]

    def _cells(self, known: dict[str, Value], now: float, *, is_stale: bool) -> Iterator[Part]:
        columns: tuple[tuple[str, Column], ...] = (
            ("who flies", _who),
            ("link", _link),
            ("battery", _battery),
            ("place", _place),
        )
        for name, column in columns:
            text, tone = column(known, now)
            yield _cell((text, Tone.DIM if is_stale else tone), _WIDTHS[name])


Column = Callable[[dict[str, Value], float], Part]
UNKNOWN: Final[Part] = ("-", Tone.DIM)


def _cell(part: Part, width: int) -> Part:
    """A part cut or filled to a width, the last column left blank."""
    text, tone = part
    return f"{text if len(text) < width else f'{text[: width - 2]}>':<{width}}", tone


def _who(known: dict[str, Value], _: float) -> Part:
    health, status = known.get("health"), known.get("control/status")
    if health is not None and not health.fields["is_alive"]:
        return f"NOT ALIVE: {on_one_line(health.fields['reason'])}", Tone.BAD
    if health is not None and health.fields["error"]:
        return f"ERROR {on_one_line(health.fields['error'])}", Tone.BAD
    if status is None:
        return UNKNOWN
    fields = status.fields
    phase, lease = fields["phase"], fields["lease"]
    word, tone = phase_part(phase)
    words = [word]
    words += [on_one_line(word) for word in (fields.get("manoeuvre"), lease and lease["holder"]) if word]
    if phase == "free" and health is not None and health.fields["motors_running"]:
        words.append("motors RUN")
    return " ".join(words), tone


def _link(known: dict[str, Value], _: float) -> Part:
    health = known.get("health")
    if health is None:
        return UNKNOWN
    word = health.fields["link"]
    tone = {"up": Tone.GOOD, "degraded": Tone.WARN}.get(word, Tone.BAD)
    return (word if word == "up" else word.upper()), tone


def _battery(known: dict[str, Value], now: float) -> Part:
    value, health = known.get("state/battery"), known.get("health")
    if value is None:
        return UNKNOWN
    if now - value.at > STALE:
        return f"STALE {age_words(now - value.at)}", Tone.WARN
    voltage, cells = value.fields["voltage"], None if health is None else health.fields.get("battery_cells")
    low = is_low(value.fields, cells)
    each = f" {voltage / cells:.2f}" if cells else ""
    return f"{'LOW ' if low else ''}{voltage:.1f}V{each}", Tone.BAD if low else Tone.PLAIN


def _place(known: dict[str, Value], now: float) -> Part:
    """The age of the pose of a target; without one, height and distance from home."""
    status, position = known.get("control/status"), known.get("state/position")
    if status is not None and (age := status.fields.get("pose_age")) is not None:
        age += now - status.at
        if age <= SIGHTING:
            return f"target {age:.1f} s", Tone.PLAIN
    if position is None:
        return UNKNOWN
    if now - position.at > STALE:
        return f"STALE {age_words(now - position.at)}", Tone.WARN
    height, away = position.fields["altitude_above_start"], position.fields["home_distance"]
    words = [f"{value:.0f}m {word}" for value, word in ((height, "up"), (away, "off")) if value is not None]
    return (" ".join(words), Tone.PLAIN) if words else ("GPS", Tone.PLAIN)

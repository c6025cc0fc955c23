"""What the terminal view says of all vehicles: a row for each, and below it what does not fit. 80 columns. Pure.

Who has gone, and who is silent, says so in words, with how long; a colour only repeats what a word says.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from textwrap import wrap
from typing import Final

from mkdaemon.reading import Fact, Picture, Reading
from mkdaemon.reading.facts import age_words
from mkdaemon.reading.known import SLOW_KEYS as KEYS
from mkdaemon.spelling import on_one_line
from mkdaemon.telemetry.tone import Tone
from mkdaemon.view.top.panels import COLUMNS, TONES, Row, RowStyle, clipped

__all__ = ["KEYS", "FleetBoard"]

_WIDTHS: Final = {"vehicle": 11, "battery": 8, "place": 18}
"""Columns before the sentence."""
_HEAD: Final = sum(_WIDTHS.values())


@dataclass
class _Vehicle:
    """One vehicle: its last values, when any of them came, and since when it has been gone."""

    reading: Reading = field(default_factory=Reading)
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

    def take(self, name: str, suffix: str, value: object, now: float) -> None:
        """Note a value; one of a vehicle that is not there, or not yet, is left out.

        Args:
            name: of the vehicle.
            suffix: its key.
            value: as its key carries it.
            now: on the viewer's clock [s].
        """
        vehicle = self._vehicles.get(name)
        if vehicle is not None and vehicle.gone_at is None:
            vehicle.reading.take(suffix, value, now)
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
        return "stale" if vehicle.reading.at(now).is_silent else "here"

    def rows(self, now: float, wall: float) -> list[Row]:
        """The screen: a title, a head, a row for each vehicle in order of their names, a foot.

        Args:
            now: on the viewer's clock [s].
            wall: the same moment [s; Unix time].
        """
        gone = sum(vehicle.gone_at is not None for vehicle in self._vehicles.values())
        count = len(self._vehicles) - gone
        title: Row = [(" fleet ", RowStyle.BAR), (f" {count} here", RowStyle.TITLE)]
        title.append((f", {gone} GONE" if gone else "", RowStyle.BAD))
        head = "".join(f"{name:<{width}}" for name, width in _WIDTHS.items())
        found = [title, [(head, RowStyle.TITLE)]]
        for name in sorted(self._vehicles):
            found += self._rows_of(name, self._vehicles[name], now, wall)
        notice = f"  {on_one_line(self.notice)}" if self.notice else ""
        found.append([(" q quit", RowStyle.BAR), (notice, RowStyle.WARN)])
        return [clipped(row, COLUMNS) for row in found]

    def _rows_of(self, name: str, vehicle: _Vehicle, now: float, wall: float) -> Iterator[Row]:
        picture = vehicle.reading.at(now)
        if vehicle.gone_at is not None:
            since = datetime.fromtimestamp(wall - (now - vehicle.gone_at), UTC)
            words = f"GONE for {age_words(now - vehicle.gone_at)}, since {since:%H:%M:%S} UTC"
            if vehicle.received_at is not None:
                before = vehicle.reading.at(vehicle.received_at)
                words += f"; last: {before.headline}, {_battery(before)}"
            yield from _row(name, "", "", [(words, Tone.BAD)])
        elif vehicle.received_at is None:
            yield from _row(name, "", "", [("no value has arrived yet", Tone.WARN)])
        else:
            worst = [(picture.headline, picture.tone), *((one.text, one.tone) for one in picture.alarms[1:])]
            yield from _row(name, _battery(picture), _place(picture), worst)


def _row(name: str, battery: str, place: str, worst: Iterable[tuple[str, Tone]]) -> Iterator[Row]:
    """A row of a vehicle; what is worst goes on below."""
    cells = zip((on_one_line(name), battery, place), _WIDTHS.values(), strict=True)
    head = "".join(f"{text if len(text) < width else f'{text[: width - 2]}>':<{width}}" for text, width in cells)
    lines = [(line, TONES[tone]) for words, tone in worst for line in wrap(words, COLUMNS - _HEAD)]
    for number, line in enumerate(lines):
        yield [(head if number == 0 else " " * _HEAD, RowStyle.TITLE if number == 0 else RowStyle.PLAIN), line]


def _number(fact: Fact, digits: int) -> str:
    """The number of a fact with its unit; a dash where it is not the present one."""
    return "-" if fact.number is None or fact.is_stale else f"{fact.number:.{digits}f} {fact.unit}"


def _battery(picture: Picture) -> str:
    return _number(picture.fact("battery"), 1)


def _place(picture: Picture) -> str:
    """The age of the pose of a target while it says where the aircraft is; else how far from home."""
    pose, place = picture.fact("pose"), picture.fact("place")
    if pose.tone is Tone.OK and not pose.is_stale:
        return f"pose {_number(pose, 1)}"
    return f"{_number(place, 0)} off" if place.number is not None and not place.is_stale else "-"

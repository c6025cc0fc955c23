"""`mkctl get` and `watch`: the last values of keys, and values as they come."""

from __future__ import annotations

import asyncio
import math
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from typing import Annotated, Any, Final, NamedTuple

from cyclopts import Parameter

from mkdaemon.cli.arguments import Count, Length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import age_of, flat, json_line
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.client import Sample
from mkdaemon.client.patterns import did_you_mean, is_known, model_of
from mkdaemon.errors import MkError


async def get(*patterns: str, lines: bool = False, connection: Connection = HERE) -> None:
    """Print the last value of keys, with its age: a field a line, with units, angles in degrees.

    Exit code 1 when none of the keys has a value yet.

    Example: mkctl get rx/nc/osd state/battery

    Args:
        patterns: Keys without `mk/<vehicle>/`; `*` stands for one chunk, `**` for any: `state/attitude`, `rx/nc/osd`,
            `state/*`, `schema/Attitude.v1`. Schemas are printed only where a key begins
            with `schema`. Default: `state/*`.
        lines: One line a value with all fields, in SI units.

    Raises:
        MkError: no value, no daemon, or a pattern is not a key expression.
    """
    async with connection.open() as client:
        found: dict[str, Sample] = {}
        empty = []
        for pattern in patterns or ("state/*",):
            values = await client.get_all(pattern)
            if not pattern.startswith("schema"):
                values = {suffix: value for suffix, value in values.items() if not suffix.startswith("schema/")}
            found |= values
            if not values:
                empty.append(pattern)
        if empty:
            absence = await client.absence()
            words = absence or f"no value for {', '.join(empty)} of vehicle {connection.vehicle} (yet){_hints(empty)}"
            if not found:
                raise MkError(words)
            print(f"mkctl: {words}", file=sys.stderr)
    for suffix, sample in sorted(found.items()):
        if connection.json:
            print(json_line({"key": suffix, **sample.fields}))
        elif not lines:
            print("\n".join(field_lines(suffix, sample.fields)))
        else:
            print(f"{on_one_line(suffix)}  {flat(sample.fields)}  {age_of(sample.fields)}".rstrip())


def _hints(patterns: list[str]) -> str:
    """What may have been meant by patterns that no key matches."""
    unknown = [pattern for pattern in patterns if not pattern.startswith("schema") and not is_known(pattern)]
    return "".join(did_you_mean(pattern) for pattern in unknown)


async def watch(
    *patterns: str,
    seconds: Length | None = None,
    count: Annotated[Count | None, Parameter(name=["--count", "-n"])] = None,
    hz: Length | None = None,
    lines: bool = False,
    connection: Connection = HERE,
) -> None:
    """Print values as they come, until Ctrl-C: columns below a heading for each key, with units, angles in degrees.

    Example: mkctl watch state/attitude --hz 2

    Args:
        patterns: Keys without `mk/<vehicle>/`: `state/**`, `event/*`, `rx/nc/osd`. Quote them, or the shell expands
            them. Default: `state/**`.
        seconds: End after this time [s].
        count: End after this number of values.
        hz: Largest rate of each key [Hz]; the newest value is printed.
        lines: One line a value with all fields, in SI units.

    Raises:
        MkError: a pattern is not a key expression.
        ConfigError: `seconds`, `count` or `hz` is not above 0.
    """
    left, columns, due = count, Columns(), Pacer(hz)
    async with connection.open() as client, client.watch(*(patterns or ("state/**",))) as samples:
        if (absence := await client.absence()) is not None:
            print(f"mkctl: {absence}; waiting for it", file=sys.stderr)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                async for sample in samples:
                    if not due.is_due(sample.suffix, asyncio.get_running_loop().time()):
                        continue
                    if connection.json:
                        print(json_line({"key": sample.suffix, **sample.fields}), flush=True)
                    elif not lines:
                        print("\n".join(columns.lines(sample.suffix, sample.fields)), flush=True)
                    else:
                        print(f"{on_one_line(sample.suffix)}  {flat(sample.fields)}", flush=True)
                    if left is not None and (left := left - 1) <= 0:
                        return


class Pacer:
    """Thins the values of every key."""

    def __init__(self, hz: float | None) -> None:
        """Let this many a second pass [Hz]; all of them for None."""
        self._period = 0.0 if hz is None else 1.0 / hz
        self._next: dict[str, float] = {}

    def is_due(self, key: str, now: float) -> bool:
        """Whether a value of a key that comes now [s] is shown."""
        if now < self._next.get(key, now):
            return False
        self._next[key] = max(self._next.get(key, now) + self._period, now)
        return True


REPEAT: Final = 20
"""Lines of a key until its heading is shown again."""
NAMES: Final = 26
"""Width of the names of fields [characters]."""
WIDE: Final = 9
"""Least width of a column [characters]."""


class Columns:
    """Values in columns, a table for each key, folded to the width of the terminal."""

    def __init__(self, width: int | None = None) -> None:
        """Begin without a heading.

        Args:
            width: columns of the screen; those of the terminal by default, 80 without one.
        """
        self._width = width or shutil.get_terminal_size((80, 24)).columns
        self._last = ""
        self._shown = 0

    def lines(self, key: str, fields: Mapping[str, Any]) -> list[str]:
        """The lines of a value; a heading first where another key came before, or long ago.

        Args:
            key: of the value.
            fields: of it; times and quaternions have no column, longer lists only their number.
        """
        groups = list(self._folded((cell.heading, cell.text) for cell in _cells(fields, _units(key))))
        has_heading = key != self._last or self._shown >= REPEAT or len(groups) > 1
        is_new = key != self._last or self._shown >= REPEAT
        self._last, self._shown = key, 1 if is_new else self._shown + 1
        lines = [key] if is_new else []
        for group in groups:
            widths = [max(WIDE, len(name), len(text)) for name, text in group]
            if has_heading:
                lines.append("  ".join(name.rjust(wide) for (name, _), wide in zip(group, widths, strict=True)))
            lines.append("  ".join(text.rjust(wide) for (_, text), wide in zip(group, widths, strict=True)))
        return [on_one_line(line) for line in lines]

    def _folded(self, cells: Iterable[tuple[str, str]]) -> Iterator[list[tuple[str, str]]]:
        """Cells in groups that fit the screen; one that is longer stands alone and is cut."""
        group: list[tuple[str, str]] = []
        used = 0
        for name, text in cells:
            shown = text if len(text) <= self._width else f"{text[: self._width - 3]}..."
            wide = max(WIDE, len(name), len(shown))
            if group and used + 2 + wide > self._width:
                yield group
                group, used = [], 0
            used += wide + (2 if group else 0)
            group.append((name, shown))
        if group:
            yield group


_UNIT: Final = re.compile(r"\[([^\],;]+)[^\]]*\]")
_IN_DEGREES: Final = {"rad": "deg", "rad/s": "deg/s"}
_NO_COLUMN: Final = frozenset({"stamp", "source", "age", "quaternion"})
_AXES: Final = ("x", "y", "z")
_WORDS: Final = {True: "yes", False: "no", None: "-"}


@cache
def _units(key: str) -> Mapping[str, str]:
    """Units of the fields of a key, as its model declares them."""
    from mkdaemon.described import meanings_of

    carried = model_of(key)
    meanings = {} if carried is None else meanings_of(carried)
    return {name: found[1] for name, meaning in meanings.items() if (found := _UNIT.search(meaning)) is not None}


def field_lines(key: str, fields: Mapping[str, Any], width: int | None = None) -> list[str]:
    """The lines of a value, a field a line; what is long goes on below.

    Args:
        key: of the value.
        fields: of it; times and quaternions are left out, longer lists are counted.
        width: columns of the screen; those of the terminal by default, 80 without one.
    """
    room = (width or shutil.get_terminal_size((80, 24)).columns) - NAMES - 3
    lines = [f"{key}  {age_of(fields)}".rstrip()]
    for cell in _cells(fields, _units(key)):
        text = on_one_line(f"{cell.text} {cell.unit}".rstrip())
        first, *more = textwrap.wrap(text, max(room, WIDE)) or [""]
        lines.append(f"  {on_one_line(cell.name):{NAMES}} {first}".rstrip())
        lines += [f"  {'':{NAMES}} {part}" for part in more]
    return [on_one_line(line) for line in lines]


class Cell(NamedTuple):
    """One field, or one part of it.

    Attributes:
        name: of the field and the axis.
        unit: empty where it has none.
        text: its value.
    """

    name: str
    unit: str
    text: str

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} {self.unit}".rstrip()


def _cells(fields: Mapping[str, Any], units: Mapping[str, str]) -> Iterator[Cell]:
    """Name, unit and text of every field that is shown."""
    for name, value in fields.items():
        is_vector = isinstance(value, list | tuple)
        parts = value if is_vector else [value]
        if name in _NO_COLUMN:
            continue
        if isinstance(value, Mapping):
            yield from _cells(value, {})
            continue
        if len(parts) > len(_AXES) or any(isinstance(part, Mapping | list | tuple) for part in parts):
            yield Cell(name, "", f"{len(parts)} values")
            continue
        unit = units.get(name, "")
        for axis, part in zip(_AXES if is_vector else ("",), parts, strict=False):
            of, shown = f"{name} {axis}".rstrip(), _IN_DEGREES.get(unit, unit)
            if isinstance(part, bool) or part is None:
                yield Cell(of, shown, _WORDS[part])
            elif isinstance(part, int | float):
                yield Cell(of, shown, f"{math.degrees(part):.1f}" if unit in _IN_DEGREES else f"{part:.7g}")
            elif isinstance(part, str):
                yield Cell(of, shown, part)

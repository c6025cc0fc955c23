"""`mkctl get` and `watch`: the last values of keys, and values as they come."""

from __future__ import annotations

import asyncio
import math
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from typing import Annotated, Any, Final

from cyclopts import Parameter

from mkdaemon.cli.arguments import require_count, require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import age_of, flat, json_line
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.client import Sample
from mkdaemon.client.patterns import did_you_mean, is_known, model_of
from mkdaemon.errors import MkError


async def get(*patterns: str, connection: Connection = HERE) -> None:
    """Print the last value of keys, with its age.

    Exit code 1 when none of the keys has a value yet.

    Example: mkctl get rx/nc/osd state/battery

    Args:
        patterns: Keys without `mk/<vehicle>/`; `*` stands for one chunk, `**` for any: `state/attitude`, `rx/nc/osd`,
            `state/*`, `schema/Attitude.v1`. Schemas are printed only where a key begins
            with `schema`. Default: `state/*`.

    Raises:
        MkError: no value, no daemon, or a pattern is no key expression.
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
        else:
            print(f"{on_one_line(suffix)}  {flat(sample.fields)}  {age_of(sample.fields)}".rstrip())


def _hints(patterns: list[str]) -> str:
    """What may have been meant by patterns that no key matches."""
    unknown = [pattern for pattern in patterns if not pattern.startswith("schema") and not is_known(pattern)]
    return "".join(did_you_mean(pattern) for pattern in unknown)


async def watch(
    *patterns: str,
    seconds: float | None = None,
    count: Annotated[int | None, Parameter(name=["--count", "-n"])] = None,
    hz: float | None = None,
    table: Annotated[bool, Parameter(negative=())] = False,
    connection: Connection = HERE,
) -> None:
    """Print values as they come, until Ctrl-C.

    Example: mkctl watch state/attitude --table --hz 2

    Args:
        patterns: Keys without `mk/<vehicle>/`: `state/**`, `event/*`, `rx/nc/osd`. Quote them, or the shell expands
            them. Default: `state/**`.
        seconds: End after so many seconds.
        count: End after so many values.
        hz: At most so many values a second of each key, the newest when one is due.
        table: Columns below a heading for each key, with units, angles in degrees.

    Raises:
        MkError: a pattern is no key expression.
        ConfigError: `seconds`, `count` or `hz` is not above 0.
    """
    require_length(seconds, "--seconds")
    require_length(hz, "--hz")
    require_count(count, "--count")
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
                    elif table:
                        print("\n".join(columns.lines(sample.suffix, sample.fields)), flush=True)
                    else:
                        print(f"{on_one_line(sample.suffix)}  {flat(sample.fields)}", flush=True)
                    if left is not None and (left := left - 1) <= 0:
                        return


class Pacer:
    """Thins the values of every key."""

    def __init__(self, hz: float | None) -> None:
        """Let so many a second pass [Hz]; all of them for None."""
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
WIDE: Final = 9
"""Least width of a column [characters]."""


class Columns:
    """Values of every key in columns of its own."""

    def __init__(self) -> None:
        self._last = ""
        self._shown = 0

    def lines(self, key: str, fields: Mapping[str, Any]) -> list[str]:
        """The lines of a value; a heading first where another key came before, or long ago.

        Args:
            key: of the value.
            fields: of it; times, quaternions, maps and longer lists have no column.
        """
        cells = list(_cells(fields, _units(key)))
        row = "  ".join(text.rjust(max(WIDE, len(name))) for name, text in cells)
        has_heading = key != self._last or self._shown >= REPEAT
        self._last, self._shown = key, 1 if has_heading else self._shown + 1
        heading = [key, "  ".join(name.rjust(WIDE) for name, _ in cells)] if has_heading else []
        return [on_one_line(line) for line in (*heading, row)]


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


def _cells(fields: Mapping[str, Any], units: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Heading and text of every column."""
    for name, value in fields.items():
        is_vector = isinstance(value, list | tuple)
        parts = value if is_vector else [value]
        if name in _NO_COLUMN or len(parts) > len(_AXES):
            continue
        unit = units.get(name, "")
        for axis, part in zip(_AXES if is_vector else ("",), parts, strict=False):
            heading = " ".join(filter(None, (name, axis, _IN_DEGREES.get(unit, unit))))
            if isinstance(part, bool) or part is None:
                yield heading, _WORDS[part]
            elif isinstance(part, int | float):
                yield heading, f"{math.degrees(part):.1f}" if unit in _IN_DEGREES else f"{part:.7g}"
            elif isinstance(part, str):
                yield heading, part

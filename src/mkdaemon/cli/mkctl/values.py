"""`mkctl get` and `watch`: the last values of keys, and values as they come."""

from __future__ import annotations

import asyncio
import sys
from contextlib import suppress
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import require_count, require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import age_of, flat, json_line
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.client import Sample
from mkdaemon.client.patterns import did_you_mean, is_known
from mkdaemon.errors import MkError


async def get(*patterns: str, connection: Connection = HERE) -> None:
    """Print the last value of keys, with its age.

    Exit code 1 when none of the keys has a value yet.

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
    connection: Connection = HERE,
) -> None:
    """Print values as they come, until Ctrl-C.

    Args:
        patterns: Keys without `mk/<vehicle>/`: `state/**`, `event/*`, `rx/nc/osd`. Quote them, or the shell expands
            them. Default: `state/**`.
        seconds: End after so many seconds.
        count: End after so many values.

    Raises:
        MkError: a pattern is no key expression.
        ConfigError: `seconds` or `count` is not above 0.
    """
    require_length(seconds, "--seconds")
    require_count(count, "--count")
    left = count
    async with connection.open() as client, client.watch(*(patterns or ("state/**",))) as samples:
        if (absence := await client.absence()) is not None:
            print(f"mkctl: {absence}; waiting for it", file=sys.stderr)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                async for sample in samples:
                    if connection.json:
                        print(json_line({"key": sample.suffix, **sample.fields}), flush=True)
                    else:
                        print(f"{on_one_line(sample.suffix)}  {flat(sample.fields)}", flush=True)
                    if left is not None and (left := left - 1) <= 0:
                        return

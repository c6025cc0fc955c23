"""`mkctl watch`: values as they come."""

from __future__ import annotations

import asyncio
import sys
from contextlib import suppress
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import require_count, require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import flat, json_line


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
                        print(f"{sample.suffix}  {flat(sample.fields)}", flush=True)
                    if left is not None and (left := left - 1) <= 0:
                        return

"""`mkctl get`: last values."""

from __future__ import annotations

import sys

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import age_of, flat, json_line
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
            print(f"{suffix}  {flat(sample.fields)}  {age_of(sample.fields)}".rstrip())


def _hints(patterns: list[str]) -> str:
    """What may have been meant by patterns that no key matches."""
    unknown = [pattern for pattern in patterns if not pattern.startswith("schema") and not is_known(pattern)]
    return "".join(did_you_mean(pattern) for pattern in unknown)

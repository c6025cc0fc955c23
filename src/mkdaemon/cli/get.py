"""`mkctl get`: last values."""

from __future__ import annotations

from mkdaemon.cli.printing import age_of, flat, json_line
from mkdaemon.cli.program import EXIT_FAILURE
from mkdaemon.cli.session import HERE, Client, Connection, Sample
from mkdaemon.errors import MkError


async def get(*patterns: str, connection: Connection = HERE) -> int:
    """Print the last value of keys, with its age.

    Exit code 1 when none of the keys has a value yet.

    Parameters
    ----------
    patterns
        Keys without `mk/<vehicle>/`; `*` stands for one chunk, `**` for any: `state/attitude`, `rx/nc/osd`,
        `state/*`, `schema/Attitude.v1`. Default: `state/*`.
    """
    async with Client.open(connection) as client:
        found: dict[str, Sample] = {}
        for pattern in patterns or ("state/*",):
            found |= await client.get(pattern)
        if not found:
            names = await client.vehicles()
            known = f"the daemon of {', '.join(names)} is there" if names else "no daemon is there"
            msg = f"no value for {' '.join(patterns)} of vehicle {connection.vehicle}; {known}"
            raise MkError(msg)
    for suffix, sample in sorted(found.items()):
        if connection.json:
            print(json_line({"key": suffix, **sample.fields}))
        else:
            print(f"{suffix}  {flat(sample.fields)}  {age_of(sample.fields)}".rstrip())
    return 0 if found else EXIT_FAILURE

"""`mkctl labels`: the names of a board's debug channels."""

from __future__ import annotations

import json
from typing import Annotated, Literal

from cyclopts import Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection


async def labels(
    board: Annotated[Literal["fc", "nc", "mag"], Parameter(help="Whose.")] = "fc",
    /,
    *,
    connection: Connection = HERE,
) -> None:
    """Read all 32 labels; the daemon keeps them by firmware, and by their checksum where the board tells one."""
    async with connection.open() as uav:
        names = (await uav.labels(board)).names
    if connection.json:
        print(json.dumps(names))
        return
    for index, name in enumerate(names):
        print(f"{index:2}  {name}")

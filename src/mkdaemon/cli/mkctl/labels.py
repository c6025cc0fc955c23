"""`mkctl labels`: the names of a board's debug channels."""

from __future__ import annotations

import json
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection

LONGEST: Final = 60.0
"""Longest time for 32 labels in the background of a busy line, or of a board behind a NaviCtrl [s]."""


async def labels(
    board: Annotated[Literal["fc", "nc", "mag"], Parameter(help="Whose.")] = "fc",
    /,
    *,
    connection: Connection = HERE,
) -> None:
    """Read all 32 labels; the daemon keeps them by firmware, and by their checksum where the board tells one."""
    async with connection.open() as client:
        answer = await client.command("do", "labels", {"board": board}, patience=LONGEST)
    names = tuple(answer.require()["names"])
    if connection.json:
        print(json.dumps(names))
        return
    for index, name in enumerate(names):
        print(f"{index:2}  {name}")

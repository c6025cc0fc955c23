"""`mkctl labels`: the names of a board's debug channels."""

from __future__ import annotations

import json
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.conversation import converse, progress_bar
from mkdaemon.protocol.procedures.labels import read_labels
from mkdaemon.protocol.procedures.steps import Patience
from mkdaemon.protocol.wire import Board

PATIENCE: Final = Patience(attempts=4)
LONGEST: Final = 60.0
"""Longest time for 32 labels in the background of a busy line [s]."""


async def labels(
    board: Annotated[Literal["fc", "nc", "mag"], Parameter(help="Whose.")] = "fc",
    /,
    *,
    connection: Connection = HERE,
) -> None:
    """Read all 32 labels; the daemon keeps them by firmware, and by their checksum where the board tells one."""
    async with connection.open() as client:
        answer = await client.command("do", "labels", {"board": board}, patience=LONGEST)
        if answer.token == "board_unreachable":
            # The daemon asks only boards on the line itself; one behind a NaviCtrl is asked label by label.
            with progress_bar("labels", quiet=connection.json) as report:
                names = await converse(client, read_labels(Board[board.upper()], PATIENCE), report)
        else:
            names = tuple(answer.require()["names"])
    if connection.json:
        print(json.dumps(names))
        return
    for index, name in enumerate(names):
        print(f"{index:2}  {name}")

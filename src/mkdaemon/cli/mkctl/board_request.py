"""Which board is asked where none is named."""

from __future__ import annotations

from collections.abc import Sequence

from mkdaemon.client import Vehicle
from mkdaemon.protocol.wire import Board


async def find_board(client: Vehicle, boards: Sequence[Board]) -> Board:
    """The board at the end of the line: the NaviCtrl where one is there, for it must not be passed through.

    Args:
        client: the daemon's client.
        boards: those that take the request.
    """
    if len(boards) > 1:
        state = await client.link.state.latest()
        present = () if state is None else state.value.boards
        if Board.NC in boards and Board.NC.word in present:
            return Board.NC
    return boards[0]

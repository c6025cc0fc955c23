"""Boards at the far end of a serial line, as the daemon's cable meets them; see `mksim.simulation`."""

from __future__ import annotations

from collections.abc import Iterable

from mksim.boards.line import HOST_CHAR
from mksim.config import SimConfig
from mksim.radio import RadioChannel


class Line:
    """Both ways of the line; bytes take their time on it.

    Attributes:
        now: simulated time [s].
    """

    def __init__(self, config: SimConfig) -> None:
        self.now = 0.0
        self._to_board = RadioChannel(config.radio.to_board, f"{config.seed} to board")
        self._to_host = RadioChannel(config.radio.to_host, f"{config.seed} to host")

    def write(self, data: bytes, at: float) -> None:
        """Send bytes to the board at `at` [s]."""
        self._to_board.push(data, at)

    def _answer(self, said: Iterable[tuple[float, int]], to: float) -> list[tuple[float, bytes]]:
        """Send on what the board said, and return what reached the host: bytes with the time they arrived [s]."""
        for at, byte in said:
            # the channel counts the character's own time, which the board has counted already
            self._to_host.push(bytes((byte,)), at - HOST_CHAR)
        self.now = to
        return self._to_host.poll(to)

"""The line of a replay: what was read from it comes at its time, what is written to it goes nowhere."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mkdaemon.errors import LinkError, LinkLostError
from mkdaemon.link.ports.port import Port

SOON: Final = 0.002
"""A port that was opened so soon after it is asked for was opened because of that [s]."""
LATE: Final = 0.02
"""An attempt that failed was made so late in the recording at most [s]."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """The line could not be used.

    Attributes:
        at: when that was known [s].
        reason: why.
        is_absent: there was no such port; else it could not be opened.
    """

    at: float
    reason: str
    is_absent: bool


class ReplayedPort:
    """An open port as it was recorded; see `Port`. The link speaks on it as it did then, and is not heard."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._chunks: deque[bytes] = deque()
        self._loss: str | None = None
        self._arrived = asyncio.Event()

    @property
    def name(self) -> str:
        """As it was opened."""
        return self._name

    @property
    def backlog(self) -> int:
        """0: what waited in the kernel is not recorded."""
        return 0

    @property
    def descriptor(self) -> int | None:
        """None: there is no device."""
        return None

    @property
    def is_recording(self) -> bool:
        """False: the link is to do what it did on the aircraft."""
        return False

    async def read(self) -> bytes:
        """Return what was read in one piece; see `Port.read`."""
        while not self._chunks:
            if self._loss is not None:
                raise LinkLostError(self._loss)
            self._arrived.clear()
            await self._arrived.wait()
        return self._chunks.popleft()

    def write(self, data: bytes) -> None:
        """Take bytes, which nobody hears.

        Raises:
            LinkLostError: the port was lost.
        """
        if self._loss is not None:
            raise LinkLostError(self._loss)

    def discard(self) -> None:
        """Do nothing."""

    async def drain(self) -> None:
        """Return at once."""

    async def close(self) -> None:
        """Do nothing."""

    def bring(self, chunk: bytes) -> None:
        """Let bytes arrive."""
        self._chunks.append(chunk)
        self._arrived.set()

    def lose(self, reason: str) -> None:
        """End it as it ended."""
        self._loss = reason
        self._arrived.set()


class ReplayedLine:
    """Where the ports of a recording are opened."""

    def __init__(self, openings: Sequence[tuple[float, str]], refusals: Sequence[Refusal]) -> None:
        """Stand ready.

        Args:
            openings: when the port was opened [s], and under which name.
            refusals: when the line was found absent or unusable, in ascending order of time.
        """
        self._openings = deque(openings)
        self._refusals = refusals
        self._loop = asyncio.get_running_loop()
        self._port: ReplayedPort | None = None

    async def open(self, url: str, *, baud: int) -> Port:
        """Open the port when it was opened, or fail as opening failed.

        Raises:
            LinkError: the recording has no port here.
        """
        now = self._loop.time()
        is_first = self._port is None
        if not self._openings or (not is_first and self._openings[0][0] > now + SOON):
            raise self._refusal(url, now)
        at, name = self._openings.popleft()
        opened = self._port = ReplayedPort(name)
        if at > now + SOON:
            await asyncio.sleep(at - now)
        return opened

    def bring(self, chunk: bytes) -> None:
        """Let bytes arrive at the open port."""
        if self._port is not None:
            self._port.bring(chunk)

    def lose(self, reason: str) -> None:
        """Let the open port be lost."""
        if self._port is not None:
            self._port.lose(reason)

    def _refusal(self, url: str, now: float) -> LinkError:
        """Why it could not be opened: the last that was known of it by then."""
        known = [refusal for refusal in self._refusals if refusal.at <= now + LATE]
        if not known:
            return LinkLostError(f"{url}: the recording has no port")
        return LinkLostError(known[-1].reason) if known[-1].is_absent else LinkError(known[-1].reason)

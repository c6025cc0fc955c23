"""The line of a replay: what was read from it comes at its time, what is written to it goes nowhere."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from mkdaemon.errors import LinkError, LinkLostError
from mkdaemon.link.ports.port import Port
from mkdaemon.record.entry import Kind
from mkdaemon.replay.script import Script

LATE: Final = 0.02
"""Why an attempt failed was published so late at most [s]."""
LINE: Final = "link"
"""Actor that opens ports."""


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

    def __init__(self, name: str, script: Script, bring_what_follows: Callable[[], None]) -> None:
        self._name = name
        self._script, self._bring_what_follows = script, bring_what_follows
        self._chunks: deque[bytes] = deque()
        self._loss: str | None = None
        self._arrived = asyncio.Event()

    @property
    def name(self) -> str:
        """As it was opened."""
        return self._name

    @property
    def backlog(self) -> int:
        """What waited in the kernel then [bytes]."""
        return self._script.backlog

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
            LinkLostError: the port was lost, or was lost by this.
        """
        self._be_used()

    def discard(self) -> None:
        """Throw nothing away.

        Raises:
            LinkLostError: the port was lost, or was lost by this.
        """
        self._be_used()

    def _be_used(self) -> None:
        follows = self._script.comes_next()
        if follows is not None and follows.entry.kind is Kind.PORT_LOST:
            self._bring_what_follows()
        if self._loss is not None:
            raise LinkLostError(self._loss)

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

    def __init__(self, script: Script, refusals: Sequence[Refusal], bring_what_follows: Callable[[], None]) -> None:
        """Stand ready.

        Args:
            script: tells what comes next.
            refusals: when the line was found absent or unusable, in ascending order of time.
            bring_what_follows: brings what comes next before anybody else acts.
        """
        self._script, self._refusals, self._bring_what_follows = script, refusals, bring_what_follows
        self._opened: asyncio.Queue[ReplayedPort] = asyncio.Queue()
        self._port: ReplayedPort | None = None

    async def open(self, url: str, *, baud: int) -> Port:
        """Open the port when it was opened, or fail as opening failed.

        Raises:
            LinkError: it could not be opened here.
        """
        if self._opened.empty() and not self._script.brings(Kind.PORT_OPENED, before=LINE):
            raise self._refusal(url)
        return await self._opened.get()

    def bring_port(self, name: str) -> None:
        """Let a port be open."""
        self._port = ReplayedPort(name, self._script, self._bring_what_follows)
        self._opened.put_nowait(self._port)

    def bring(self, chunk: bytes) -> None:
        """Let bytes arrive at the open port."""
        if self._port is not None:
            self._port.bring(chunk)

    def lose(self, reason: str) -> None:
        """Let the open port be lost."""
        if self._port is not None:
            self._port.lose(reason)

    def _refusal(self, url: str) -> LinkError:
        """Why it could not be opened: what was said of it then."""
        failed_at = self._script.next_of(LINE)
        known = [refusal for refusal in self._refusals if failed_at is None or refusal.at <= failed_at + LATE]
        if not known:
            return LinkLostError(f"{url}: the recording has no port")
        return LinkLostError(known[-1].reason) if known[-1].is_absent else LinkError(known[-1].reason)

"""Setpoints on their way from Zenoh's threads to the loop."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import zenoh

from mkdaemon.bus.codec import Payload, TooLong
from mkdaemon.bus.floods import STRANGER_RATE, Budget
from mkdaemon.bus.keys import REQUEST_BYTES, find
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.signature import SIGNATURE_BYTES

FLOOD: Final = 64
"""Setpoints of the holder taken in one turn of the loop; an honest client sends one in twenty milliseconds."""
STRANGERS: Final = 4
"""Setpoints of others taken in one turn, so that they are refused by name."""

Taker = Callable[[float, Payload, int | None], CommandRejectedError | None]
"""Takes a setpoint: arrival [s; monotonic], payload, epoch of the lease whose holder signed it; called on the loop,
returns at once, never raises. Returns why it was refused."""
Verifier = Callable[[Payload, bytes], int | None]
"""Epoch of the lease whose holder signed a payload; None where he did not. Called on any thread, once a setpoint."""


class Arrived(NamedTuple):
    """A setpoint that has arrived.

    Attributes:
        at: when [s; monotonic].
        payload: as it came.
        proof: its signature.
        signed_for: epoch of the lease whose holder signed it; None where he did not.
        source: the session it says it comes from; None where it says nothing.
    """

    at: float
    payload: Payload
    proof: bytes
    signed_for: int | None
    source: zenoh.SourceInfo | None


class SetpointIntake:
    """Hands every setpoint of a key to the loop, those of the holder on a way of their own.

    Nothing waits here: all that arrived is handed over in the next turn of the loop, and the newest valid one wins
    there. It is not one slot, or a stranger's setpoint, refused a moment later, would displace the pilot's. Of a flood,
    the newest of each turn are handed over and the older ones dropped: the loop has other work.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        take: Callable[[Arrived], None],
        verify: Verifier,
        shed: Callable[[], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take setpoints of one key.

        Args:
            loop: where `take` is called.
            take: takes them.
            verify: tells those of the holder from others.
            shed: called, on any thread, for each setpoint that was dropped.
            clock: what a second is, for strangers' setpoints that are too many in it [s].
        """
        self._loop, self._take, self._verify, self._shed = loop, take, verify, shed
        self._lock = threading.Lock()
        self._holders: deque[Arrived] = deque(maxlen=FLOOD)
        self._others: deque[Arrived] = deque(maxlen=STRANGERS)
        self._strangers = Budget(STRANGER_RATE, clock)
        self._is_called = False

    def arrived(self, payload: Payload, proof: bytes, source: zenoh.SourceInfo | None = None) -> None:
        """Take a setpoint; from any thread, returns at once."""
        signed_for = self._verify(payload, proof)
        if signed_for is None and not self._strangers.admits():
            self._shed()
            return
        waiting = self._others if signed_for is None else self._holders
        with self._lock:
            is_full = len(waiting) == waiting.maxlen
            waiting.append(Arrived(time.monotonic(), payload, proof, signed_for, source))
            must_call, self._is_called = not self._is_called, True
        if is_full:
            self._shed()
        if must_call:
            self._loop.call_soon_threadsafe(self._drain)

    def _drain(self) -> None:
        with self._lock:
            self._is_called = False
            arrived = [*self._others, *self._holders]
            self._others.clear()
            self._holders.clear()
        for setpoint in arrived:
            self._take(setpoint)


def read_signature(attachment: zenoh.ZBytes | None) -> bytes:
    """Copy a signature; what has not its length is none."""
    is_signed = attachment is not None and len(attachment) == SIGNATURE_BYTES
    return attachment.to_bytes() if attachment is not None and is_signed else b""


def read_source(info: zenoh.SourceInfo | None) -> str:
    """Id of the session that a sample or query says it comes from; empty where it says nothing."""
    return "" if info is None else str(info.source_id.zid)


def read_payload(payload: zenoh.ZBytes | None, suffix: str) -> Payload:
    """Copy what somebody sent to a key, unless it is longer than anything honest there."""
    if payload is None:
        return b""
    spec = find(suffix)
    limit = REQUEST_BYTES if spec is None else spec.max_bytes
    size = len(payload)
    return payload.to_bytes() if size <= limit else TooLong(size, limit)

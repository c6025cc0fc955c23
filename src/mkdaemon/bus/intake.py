"""Setpoints on their way from Zenoh's threads to the loop."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import zenoh

from mkdaemon.bus.codec import Payload, TooLate, TooLong
from mkdaemon.bus.floods import STRANGER_RATE, UNSTAMPED_RATE, Budget, Silencer
from mkdaemon.bus.keys import REQUEST_BYTES, find
from mkdaemon.bus.senderclock import SenderClock
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.signature import SIGNATURE_BYTES, STAMP_BYTES, stamp_of

PERIOD: Final = 0.005
"""Between two setpoints of the holder that are handed to the loop [s]; an honest client sends one in 0.02 s."""
LATEST: Final = 0.3
"""A setpoint that was sent longer ago is not read [s]: `control.limiter.setpoint_ttl` is the same where it is not
configured, and what is older is not flown."""
FLOOD: Final = 8
"""Up to this number that newer ones replaced within `PERIOD` are no flood: a network that stood still delivers them
together."""
STRANGERS: Final = 4
"""Setpoints of others taken in one turn, so that they are refused by name."""

Taker = Callable[[float, Payload, int | None], CommandRejectedError | None]
"""Takes a setpoint: when it was sent, or else when it arrived [s; monotonic], payload, epoch of the lease whose holder
signed it; called on the loop, returns at once, never raises. Returns why it was refused."""
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
        sent: when it was sent, by our clock [s; monotonic]; None where it does not say.
    """

    at: float
    payload: Payload
    proof: bytes
    signed_for: int | None
    source: zenoh.SourceInfo | None
    sent: float | None = None


class SetpointIntake:
    """Hands setpoints of a key to the loop, those of the holder separately: of these the newest alone.

    It is not one slot for all, or a stranger's setpoint, refused a moment later, would displace the pilot's. The
    holder's are handed over `PERIOD` apart at least: one that floods costs the loop no more than one that does not,
    and what waits for a thread of Zenoh is read at the speed of that thread. What was sent too long ago is not read.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        take: Callable[[Arrived], None],
        verify: Verifier,
        shed: Callable[[], None],
        clock: Callable[[], float] = time.monotonic,
        sender: SenderClock | None = None,
    ) -> None:
        """Take setpoints of one key.

        Args:
            loop: where `take` is called.
            take: takes them.
            verify: tells those of the holder from others.
            shed: called, on any thread, for each setpoint that was dropped.
            clock: what a second is, for setpoints that are too many in it [s].
            sender: learns when the holder's were sent; one for all keys.
        """
        self._loop, self._take, self._verify, self._shed = loop, take, verify, shed
        self._sender = sender or SenderClock()
        self._lock = threading.Lock()
        self._newest: Arrived | None = None
        self._late: Arrived | None = None
        self._superseded = 0
        self._others: deque[Arrived] = deque(maxlen=STRANGERS)
        self._strangers = Budget(STRANGER_RATE, clock)
        self._unstamped = Silencer(UNSTAMPED_RATE, clock)
        self._is_called = False
        self._next_at = -math.inf

    def arrived(self, payload: Payload, proof: bytes, source: zenoh.SourceInfo | None = None) -> None:
        """Take a setpoint; from any thread, returns at once."""
        signed_for, now = self._verify(payload, proof), time.monotonic()
        if signed_for is None and not self._strangers.admits():
            self._shed()
            return
        setpoint = self._judge(Arrived(now, payload, proof, signed_for, source))
        with self._lock:
            is_shed = self._keep(setpoint)
            must_call, self._is_called = not self._is_called, True
        if is_shed:
            self._shed()
        if must_call:
            self._loop.call_soon_threadsafe(self._begin)

    def _judge(self, setpoint: Arrived) -> Arrived:
        """Find out when a setpoint of the holder was sent; too late a one is not to be read."""
        if setpoint.signed_for is None:
            return setpoint
        stamp, size = stamp_of(setpoint.proof), len(setpoint.payload) if isinstance(setpoint.payload, bytes) else 0
        if stamp is None:
            late = None if self._unstamped.admits() else TooLate(size, None, LATEST)
            return setpoint if late is None else setpoint._replace(payload=late)
        sent = self._sender.sent(setpoint.signed_for, stamp, setpoint.at)
        age = setpoint.at - sent
        return setpoint._replace(sent=sent, payload=TooLate(size, age, LATEST) if age > LATEST else setpoint.payload)

    def _keep(self, setpoint: Arrived) -> bool:
        """Let it wait for the loop; returns whether one was dropped that counts."""
        if setpoint.signed_for is None:
            is_full = len(self._others) == STRANGERS
            self._others.append(setpoint)
            return is_full
        if isinstance(setpoint.payload, TooLate):
            is_shed, self._late = self._late is not None, setpoint
            return is_shed
        self._superseded += self._newest is not None
        self._newest = setpoint
        return self._superseded > FLOOD

    def _begin(self) -> None:
        """Hand over now, or when the time has come; on the loop."""
        now = time.monotonic()
        if now >= self._next_at:
            self._drain()
        else:
            self._loop.call_later(self._next_at - now, self._drain)

    def _drain(self) -> None:
        with self._lock:
            self._is_called = False
            arrived = [*self._others, *(one for one in (self._late, self._newest) if one is not None)]
            if self._newest is not None or self._late is not None:
                self._next_at = time.monotonic() + PERIOD
            self._newest = self._late = None
            self._superseded = 0
            self._others.clear()
        for setpoint in arrived:
            self._take(setpoint)


def read_signature(attachment: zenoh.ZBytes | None) -> bytes:
    """Copy a signature, with its stamp; what has not its length is none."""
    lengths = (SIGNATURE_BYTES, SIGNATURE_BYTES + STAMP_BYTES)
    is_signed = attachment is not None and len(attachment) in lengths
    return attachment.to_bytes() if attachment is not None and is_signed else b""


def read_source(info: zenoh.SourceInfo | None) -> str:
    """Id of the session that a sample or query says it comes from; empty where it says nothing."""
    return "" if info is None else str(info.source_id.zid)


def read_payload(payload: zenoh.ZBytes | None, suffix: str) -> Payload:
    """Copy a payload, unless it is longer than any valid one for this key."""
    if payload is None:
        return b""
    spec = find(suffix)
    limit = REQUEST_BYTES if spec is None else spec.max_bytes
    size = len(payload)
    return payload.to_bytes() if size <= limit else TooLong(size, limit)

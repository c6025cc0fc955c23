"""The bus as a recorder sees it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from mkdaemon.bus.intake import Arrived, Taker, read_source
from mkdaemon.stamp import Stamp


class BusRecorder(Protocol):
    """Takes what crosses the bus; called on the loop, returns at once and never raises."""

    def sample(self, suffix: str, payload: bytes, encoding: str, stamp: Stamp | None) -> None:
        """Take a value that is published."""

    def setpoint(
        self, suffix: str, payload: bytes, encoding: str, signature: bytes, *, at: float, source: str, is_holder: bool
    ) -> None:
        """Take a setpoint.

        Args:
            suffix: key without `mk/<vehicle>/`.
            payload: as it came.
            encoding: as its key has it.
            signature: its attachment.
            at: when it arrived [s; monotonic].
            source: Zenoh id of the session it says it comes from; empty where it says none.
            is_holder: whether it is signed with the secret of the lease.
        """

    def setpoint_refused(self, suffix: str, token: str, reason: str) -> None:
        """Take that the last setpoint of a key was refused, and why."""

    def query(self, suffix: str, payload: bytes, exchange: int, source: str) -> None:
        """Take a command that arrived from a source, as it says; its answer has the same number."""

    def reply(self, suffix: str, payload: bytes, encoding: str, exchange: int) -> None:
        """Take the answer to a command."""


class NoRecorder:
    """Recorder that records nothing."""

    def sample(self, suffix: str, payload: bytes, encoding: str, stamp: Stamp | None) -> None:
        """Take no notice."""

    def setpoint(
        self, suffix: str, payload: bytes, encoding: str, signature: bytes, *, at: float, source: str, is_holder: bool
    ) -> None:
        """Take no notice."""

    def setpoint_refused(self, suffix: str, token: str, reason: str) -> None:
        """Take no notice."""

    def query(self, suffix: str, payload: bytes, exchange: int, source: str) -> None:
        """Take no notice."""

    def reply(self, suffix: str, payload: bytes, encoding: str, exchange: int) -> None:
        """Take no notice."""


def recorded_taker(recorder: BusRecorder, suffix: str, encoding: str, take: Taker) -> Callable[[Arrived], None]:
    """Pass the setpoints of a key to a recorder and then to `take`, and its refusals to the recorder.

    Args:
        recorder: hears of them.
        suffix: key without `mk/<vehicle>/`.
        encoding: of what it carries.
        take: takes them.
    """

    def record_and_take(arrived: Arrived) -> None:
        at, payload, proof, signed_for, source, sent = arrived
        counts_from = at if sent is None else sent
        if not isinstance(payload, bytes):
            take(counts_from, payload, signed_for)
            return
        is_holder = signed_for is not None
        source_id = read_source(source)
        recorder.setpoint(suffix, payload, encoding, proof, at=at, source=source_id, is_holder=is_holder)
        refusal = take(counts_from, payload, signed_for)
        if refusal is not None:
            recorder.setpoint_refused(suffix, refusal.token, refusal.reason)

    return record_and_take

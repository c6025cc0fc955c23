"""What the bus shows to a recorder."""

from __future__ import annotations

from typing import Protocol

from mkdaemon.stamp import Stamp


class BusRecorder(Protocol):
    """Takes what crosses the bus; called on the loop, returns at once and never raises."""

    def sample(self, suffix: str, payload: bytes, encoding: str, stamp: Stamp | None) -> None:
        """Take a value that is published."""

    def setpoint(self, suffix: str, payload: bytes, encoding: str, signature: bytes, at: float) -> None:
        """Take a setpoint that arrived at a time [s; monotonic]."""

    def query(self, suffix: str, payload: bytes, exchange: int) -> None:
        """Take a command that arrived; its answer has the same number."""

    def reply(self, suffix: str, payload: bytes, encoding: str, exchange: int) -> None:
        """Take the answer to a command."""

    def client(self, name: str, is_here: bool) -> None:
        """Take a client's coming or going."""


class NoRecorder:
    """Where nothing is recorded."""

    def sample(self, suffix: str, payload: bytes, encoding: str, stamp: Stamp | None) -> None:
        """Take no notice."""

    def setpoint(self, suffix: str, payload: bytes, encoding: str, signature: bytes, at: float) -> None:
        """Take no notice."""

    def query(self, suffix: str, payload: bytes, exchange: int) -> None:
        """Take no notice."""

    def reply(self, suffix: str, payload: bytes, encoding: str, exchange: int) -> None:
        """Take no notice."""

    def client(self, name: str, is_here: bool) -> None:
        """Take no notice."""

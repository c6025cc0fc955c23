"""The interface of a device: it answers queries, reports changes, and may vanish."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from mkdaemon.client.teleop.inputs import PadFacts
from mkdaemon.errors import MkError


class DeviceLostError(MkError):
    """A device is gone; says which and why."""


@dataclass(frozen=True, slots=True)
class DeviceState:
    """What a device answered.

    Attributes:
        values: raw values by control.
        at: when they were true [s; monotonic].
    """

    values: Mapping[str, float]
    at: float


class Device(Protocol):
    """A pad, the keyboard, or a pad of another machine.

    Attributes:
        name: a unique name, for example its path.
        facts: what it says about itself.
    """

    name: str
    facts: PadFacts

    def ask(self, now: float) -> DeviceState | None:
        """Return the state of every control; None where it has not said anything yet.

        Raises:
            DeviceLostError: it is gone.
        """

    def alarm(self) -> None:
        """Shake, or ring a bell: the aircraft is out of reach."""

    def let_go(self) -> None:
        """Take note that the aircraft was released."""

    def close(self) -> None:
        """Give it back to the system."""

"""The raw state of one pad: every axis and button with the time it was last known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

HALF: Final = 0.5
"""An axis beyond this share of its way counts as pressed where it serves as a button."""


class HandSticks(NamedTuple):
    """Stick offsets [stick; FLU]: pitch + nose down, roll + right side down, yaw + nose left, throttle + lift."""

    pitch: float
    roll: float
    yaw: float
    throttle: float


@dataclass(frozen=True, slots=True)
class AxisRange:
    """What an axis can say.

    Attributes:
        low: smallest raw value.
        high: largest raw value.
    """

    low: float
    high: float

    def normalise(self, raw: float) -> float:
        """Return a raw value as a share of the way, -1..1."""
        if self.high <= self.low:
            return 0.0
        return min(max(2.0 * (raw - self.low) / (self.high - self.low) - 1.0, -1.0), 1.0)


@dataclass(frozen=True, slots=True)
class PadFacts:
    """What a pad says about itself.

    Attributes:
        name: in words.
        ranges: of its axes, by the kernel's name.
        buttons: its buttons, by the kernel's name.
        is_wireless: it is reached by Bluetooth.
        speaker: who answers for all of its controls together, in words; empty where each is asked.
    """

    name: str
    ranges: Mapping[str, AxisRange]
    buttons: frozenset[str] = frozenset()
    is_wireless: bool = False
    speaker: str = ""


class PadInputs:
    """Values and ages of one pad's controls.

    Attributes:
        reported_at: when the pad last reported anything by itself [s].
    """

    def __init__(self, facts: PadFacts, at: float) -> None:
        self._facts = facts
        self._values: dict[str, float] = {}
        self._seen: dict[str, float] = {}
        self.reported_at = at

    def reported(self, control: str, raw: float, at: float) -> None:
        """Take one change that the pad reported.

        Args:
            control: axis or button, by the kernel's name.
            raw: as it came; a button is 0 or 1.
            at: when [s; monotonic].
        """
        self.reported_at = max(self.reported_at, at)
        self._put(control, raw, at)

    def asked(self, state: Mapping[str, float], at: float) -> None:
        """Take the state the pad answered when it was asked.

        Args:
            state: raw values by control.
            at: when [s; monotonic].
        """
        for control, raw in state.items():
            self._put(control, raw, at)

    def _put(self, control: str, raw: float, at: float) -> None:
        if at < self._seen.get(control, at):
            return
        span = self._facts.ranges.get(control)
        self._values[control] = raw if span is None else span.normalise(raw)
        self._seen[control] = at

    def axis(self, reference: str) -> float:
        """Return where an axis stands, -1..1; 0 where it was never known.

        Args:
            reference: its name; `-` in front turns it round.
        """
        name = reference.removeprefix("-")
        value = self._values.get(name, 0.0)
        return -value if reference != name else value

    def is_pressed(self, reference: str) -> bool:
        """Return whether a button, or an axis as a button, is pressed.

        Args:
            reference: its name; with `+` or `-` behind it the half of an axis.
        """
        name = reference.rstrip("+-")
        value = self._values.get(name, 0.0)
        if reference.endswith("-"):
            return value < -HALF
        return value > HALF

    def oldest(self, references: Iterable[str], now: float) -> tuple[str, float]:
        """Return which of some controls was known longest ago, and its age [s]; infinite where it never was."""
        names = [reference.removeprefix("-").rstrip("+-") for reference in references]
        name = min(names, key=lambda control: self._seen.get(control, float("-inf")))
        return name, now - self._seen.get(name, float("-inf"))

    def missing(self, references: Iterable[str]) -> list[str]:
        """Return which controls this pad does not have."""
        names = [reference.removeprefix("-").rstrip("+-") for reference in references]
        return sorted({name for name in names if name not in self._facts.ranges and name not in self._facts.buttons})

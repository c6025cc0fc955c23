"""The faults that run now, out of the table in `telemetry.sim_faults`.

The world applies its own; the boards, the radio and the scene read theirs with `is_active` and `value`.
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.sim_faults import FAULTS, FaultChoice, FaultSpec, FaultValue


@dataclass(frozen=True, slots=True)
class ActiveFault:
    """A running fault: its values, when it began and when it ends [s] (infinity: when stopped)."""

    values: dict[str, FaultValue]
    began: float
    ends: float


class RunningFaults:
    """The faults running now.

    Attributes:
        now: simulated time, kept by the world [s].
        generation: grows with every change, so that a reader can compare it cheaply.
        active: running faults by name.
    """

    __slots__ = ("_next_end", "active", "generation", "now")

    def __init__(self) -> None:
        self.now = 0.0
        self.generation = 0
        self.active: dict[str, ActiveFault] = {}
        self._next_end = math.inf

    def start(self, name: str, *, duration: float | None = None, **values: FaultValue) -> None:
        """Start a fault, or start it again with other values.

        Args:
            name: a key of `FAULTS`.
            duration: how long [s]; unset takes the table's.
            values: the fault's parameters; those left out take the table's.

        Raises:
            CommandRejectedError: no such fault or parameter, or a value out of range.
        """
        spec = _spec(name)
        taken: dict[str, FaultValue] = {key: parameter.default for key, parameter in spec.parameters.items()}
        for key, value in values.items():
            taken[key] = _checked(name, spec, key, value)
        if duration is not None and not 0.0 < duration < math.inf:
            raise refuse(
                Token.OUT_OF_RANGE, name=f"duration of {name!r}", value=duration, wanted="a duration above 0 s"
            )
        lasts = spec.duration if duration is None else duration
        self.active[name] = ActiveFault(taken, self.now, math.inf if lasts is None else self.now + lasts)
        self._changed()

    def stop(self, name: str) -> None:
        """Stop a fault; stopping one that does not run is no mistake.

        Raises:
            CommandRejectedError: no such fault.
        """
        _spec(name)
        if self.active.pop(name, None) is not None:
            self._changed()

    def clear(self) -> None:
        """Stop everything."""
        self.active.clear()
        self._changed()

    def is_active(self, name: str) -> bool:
        """Say whether a fault runs."""
        return name in self.active

    def number(self, name: str, parameter: str) -> float:
        """Return a number of a running fault; its default while the fault does not run."""
        return float(self._value(name, parameter))

    def word(self, name: str, parameter: str) -> str:
        """Return a word of a running fault; its default while the fault does not run."""
        return str(self._value(name, parameter))

    def take(self, name: str) -> bool:
        """Consume an event: true once after each start."""
        if name not in self.active:
            return False
        self.stop(name)
        return True

    def is_link_cut(self, direction: str) -> bool:
        """Say whether the link is cut in `direction`, `to_board` or `to_host`."""
        return "link_cut" in self.active and self.word("link_cut", "direction") in ("both", direction)

    def advance(self, now: float) -> None:
        """Set the time [s] and end what has run out."""
        self.now = now
        if now < self._next_end:
            return
        for name in [name for name, fault in self.active.items() if fault.ends <= now]:
            del self.active[name]
        self._changed()

    def _value(self, name: str, parameter: str) -> FaultValue:
        fault = self.active.get(name)
        return FAULTS[name].parameters[parameter].default if fault is None else fault.values[parameter]

    def _changed(self) -> None:
        self.generation += 1
        self._next_end = min((fault.ends for fault in self.active.values()), default=math.inf)


def _spec(name: str) -> FaultSpec:
    spec = FAULTS.get(name)
    if spec is None:
        near = difflib.get_close_matches(name, FAULTS, n=1, cutoff=0.0)[0]
        raise refuse(Token.UNKNOWN_FAULT, name=name, near=near, known=", ".join(FAULTS))
    return spec


def _checked(name: str, spec: FaultSpec, key: str, value: FaultValue) -> FaultValue:
    parameter = spec.parameters.get(key)
    if parameter is None:
        known = ", ".join(spec.parameters) or "none"
        raise refuse(Token.UNKNOWN_PARAMETER, name=name, parameter=key, known=known)
    if isinstance(parameter, FaultChoice):
        if value not in parameter.choices:
            wanted = ", ".join(parameter.choices)
            raise refuse(Token.OUT_OF_RANGE, name=f"{key} of {name!r}", value=repr(value), wanted=wanted)
        return value
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not parameter.low <= number <= parameter.high or (parameter.whole and number % 1.0):
        unit = f" {parameter.unit}" if parameter.unit else ""
        wanted = f"{'a whole number from ' if parameter.whole else ''}{parameter.low:g} to {parameter.high:g}{unit}"
        raise refuse(Token.OUT_OF_RANGE, name=f"{key} of {name!r}", value=value, wanted=wanted)
    return number

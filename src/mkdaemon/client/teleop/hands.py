"""One pad and its mapping: what its sticks ask for, which buttons were pressed, and whether it can be trusted."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final

from mkdaemon.client.teleop.inputs import HandSticks, PadFacts, PadInputs
from mkdaemon.client.teleop.shaping import LOWEST, AxisNames, Thrust, shape
from mkdaemon.config.gamepad import MOST_TRIM, AxisSection, Gamepad

AXIS_AGE: Final = 0.25
"""An axis or enable button not known for longer counts as lost [s]: neutral sticks reach the wire within 350 ms."""
QUIET: Final = 2.0
"""A pad by radio with a deflected stick that reports nothing for longer counts as gone [s]; no thumb is so still."""
DEFLECTED: Final = 0.25
"""A stick beyond this share takes over from a manoeuvre, and must not be still for long on a pad by radio."""
TRIM_STEP: Final = 1.0
"""Of one press [stick]."""


class Function(StrEnum):
    """What a button does; the values are the keys of `[buttons]` in a mapping."""

    ENABLE = "enable"
    FINE = "fine"
    THRUST_LOCK = "thrust_lock"
    RECENTRE = "recentre"
    RESET = "reset"
    TAKEOFF = "takeoff"
    HOLD = "hold"
    LAND = "land"
    RELEASE = "release"
    STOP = "stop"
    TRIM_FORWARD = "trim_forward"
    TRIM_BACK = "trim_back"
    TRIM_LEFT = "trim_left"
    TRIM_RIGHT = "trim_right"


HELD_FOR: Final[Mapping[Function, float]] = MappingProxyType(
    {Function.TAKEOFF: 0.5, Function.LAND: 0.5, Function.STOP: 1.0}
)
"""How long a button must be held before it counts [s]; the others count at once."""
_TRIMS: Final = {
    Function.TRIM_FORWARD: ("pitch", TRIM_STEP),
    Function.TRIM_BACK: ("pitch", -TRIM_STEP),
    Function.TRIM_RIGHT: ("roll", TRIM_STEP),
    Function.TRIM_LEFT: ("roll", -TRIM_STEP),
}


@dataclass(frozen=True, slots=True)
class Lapse:
    """Why a pad does not fly at the moment.

    Attributes:
        reason: in words.
        since: when it was last in order [s].
        is_input_lost: the sticks cannot be believed, so the thrust is not above hover either.
    """

    reason: str
    since: float
    is_input_lost: bool


class PadHands:
    """One pad and what its user does with it.

    Attributes:
        pad: its mapping.
        facts: what it says about itself.
        inputs: its raw state.
        thrust: its thrust stick.
        trims: pitch and roll [stick].
        is_fine: small deflections.
        has_seen_zero: the thrust stick was at its lowest since the pad came.
    """

    def __init__(self, pad: Gamepad, facts: PadFacts, at: float) -> None:
        self.pad, self.facts = pad, facts
        self.inputs = PadInputs(facts, at)
        self.thrust = Thrust(pad.thrust)
        self.is_fine = self.has_seen_zero = False
        self.trims = {"pitch": pad.pitch.trim, "roll": pad.roll.trim}
        self.axes = AxisNames.of(pad)
        given = pad.buttons.model_dump()
        self._buttons = {function: given[function] for function in Function if given[function] is not None}
        self._is_known = False
        self._stuck: set[Function] = set()
        self._down: dict[Function, float] = {}
        self._waiting: set[Function] = set()
        self._pressed: list[Function] = []
        quiet = QUIET if facts.is_wireless else None
        self._quiet = quiet if pad.quiet_after is None else pad.quiet_after
        self._enabled_at = at

    @property
    def missing(self) -> list[str]:
        """Axes and buttons of the mapping that this pad does not have."""
        return self.inputs.missing([*self.axes.all, *self._buttons.values()])

    def reported(self, control: str, raw: float, at: float) -> None:
        """Take a change; see `PadInputs.reported`."""
        self.inputs.reported(control, raw, at)
        self._look(at)

    def asked(self, state: Mapping[str, float], at: float) -> None:
        """Take the state; see `PadInputs.asked`. What is pressed the first time is ignored until its release."""
        self.inputs.asked(state, at)
        if not self._is_known:
            self._is_known = True
            self._stuck = {function for function, ref in self._buttons.items() if self.inputs.is_pressed(ref)}
        self._look(at)

    def _look(self, at: float) -> None:
        """Note what was pressed and released, and move the thrust."""
        if not self._is_known:
            return
        for function, reference in self._buttons.items():
            if not self.inputs.is_pressed(reference):
                self._stuck.discard(function)
                self._waiting.discard(function)
                self._down.pop(function, None)
            elif function not in self._stuck and function not in self._down:
                self._down[function] = at
                if function in HELD_FOR:
                    self._waiting.add(function)
                else:
                    self._pressed.append(function)
        position = self.inputs.axis(self.axes.throttle)
        self.has_seen_zero = self.has_seen_zero or position <= LOWEST
        if self.has_seen_zero:
            self.thrust.move(position)

    def take_presses(self, now: float) -> list[Function]:
        """Do what buttons of this pad alone ask for; return the others that were pressed since the last call."""
        held = [f for f in self._waiting if now - self._down[f] >= HELD_FOR[f]]
        self._waiting.difference_update(held)
        pressed, self._pressed = [*self._pressed, *held], []
        return [function for function in pressed if not self._set(function)]

    def _set(self, function: Function) -> bool:
        """Carry out a setting; whether it was one."""
        match function:
            case Function.FINE:
                self.is_fine = not self.is_fine
            case Function.THRUST_LOCK:
                self.thrust.toggle_lock()
            case Function.RECENTRE:
                self.thrust.recentre()
            case Function.RESET:
                self.is_fine = False
                self.trims = {"pitch": self.pad.pitch.trim, "roll": self.pad.roll.trim}
                self.thrust.reset()
            case _ if function in _TRIMS:
                axis, step = _TRIMS[function]
                self.trims[axis] = min(max(self.trims[axis] + step, -MOST_TRIM), MOST_TRIM)
            case _:
                return False
        return True

    @property
    def is_enabled(self) -> bool:
        """Whether the enable button is held, and was released before."""
        return Function.ENABLE in self._down

    @property
    def stuck(self) -> list[str]:
        """Buttons that have been pressed since before the pad was known."""
        return sorted(self._buttons[function] for function in self._stuck)

    def obstacle(self, pressed: Collection[Function], now: float, *, is_on_ground: bool | None) -> str:
        """Why the enable button of this pad counts for nothing, in words; empty where it counts.

        Args:
            pressed: what was pressed just now.
            now: [s].
            is_on_ground: the aircraft is known to stand; None if unknown.
        """
        enable = self._buttons[Function.ENABLE]
        if not self._is_known:
            return f"{self.facts.name} has not answered yet"
        if missing := self.inputs.missing([*self.axes.all, enable]):
            return f"{self.facts.name} has no {', '.join(missing)}: another pad? `mkctl teleop --learn`"
        if Function.ENABLE in self._stuck:
            return f"{enable} was pressed at the start: release it"
        if not self.has_seen_zero:
            return "pull the thrust stick to its lowest once"
        if (lost := self._input_lost(now)) is not None:
            return lost.reason
        if is_on_ground and self.inputs.axis(self.axes.throttle) > LOWEST:
            return "the aircraft stands: hold the thrust stick at its lowest to begin"
        if self.is_enabled and Function.ENABLE not in pressed:
            return f"release {enable} and press it again"
        return ""

    def lapse(self, now: float) -> Lapse | None:
        """Why the pad that flies does not fly now; None where all is well."""
        if (lost := self._input_lost(now)) is not None:
            return lost
        if not self.is_enabled:
            return Lapse(f"{self._buttons[Function.ENABLE]} is not held", self._enabled_at, is_input_lost=False)
        self._enabled_at = now
        return None

    def _input_lost(self, now: float) -> Lapse | None:
        name, age = self.inputs.oldest([*self.axes.all, self._buttons[Function.ENABLE]], now)
        if age > AXIS_AGE:
            silent = f"{self.facts.speaker} has not answered" if self.facts.speaker else f"no state is known of {name}"
            return Lapse(f"{silent} for {age:.2f} s", now - age, is_input_lost=True)
        quiet = now - self.inputs.reported_at
        if self._quiet is not None and quiet > self._quiet and self.deflection() > DEFLECTED:
            reason = f"{self.facts.name} reports nothing for {quiet:.1f} s: out of reach?"
            return Lapse(reason, self.inputs.reported_at + self._quiet, is_input_lost=True)
        return None

    def deflection(self) -> float:
        """Largest deflection of pitch, roll and yaw, 0..1."""
        axes = ((self.axes.pitch, self.pad.pitch), (self.axes.roll, self.pad.roll), (self.axes.yaw, self.pad.yaw))
        return max(abs(self._share(axis, feel)) for axis, feel in axes)

    def wish(self, *, is_engaged: bool) -> HandSticks:
        """What the sticks ask for now.

        Args:
            is_engaged: the daemon flies; before, it waits for neutral sticks, so trims are left out.
        """
        scale = self.pad.fine_scale if self.is_fine else 1.0
        shares = {
            "pitch": self._share(self.axes.pitch, self.pad.pitch),
            "roll": self._share(self.axes.roll, self.pad.roll),
            # Stick to the right turns the nose right, and FLU counts to the left; docs/frames.md.
            "yaw": -self._share(self.axes.yaw, self.pad.yaw),
        }
        counts = {axis: share * scale * getattr(self.pad, axis).rate for axis, share in shares.items()}
        if is_engaged:
            counts = {axis: value + self.trim(axis) for axis, value in counts.items()}
        return HandSticks(**{axis: _clip(value) for axis, value in counts.items()}, throttle=self.thrust.value)

    def trim(self, axis: str) -> float:
        """Trim of an axis [stick]."""
        return self.trims.get(axis, self.pad.yaw.trim)

    def _share(self, axis: str, feel: AxisSection) -> float:
        return shape(self.inputs.axis(axis), deadzone=feel.deadzone, expo=feel.expo)


def _clip(value: float) -> float:
    return min(max(value, -127.0), 127.0) + 0.0  # no minus zero

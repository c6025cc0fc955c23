"""Who of the pads flies, and what is streamed for it: enable button, ladder, manoeuvres by button.

Nothing happens between calls; `now` is an argument [s; monotonic]. Source of the times: docs/safety.md, docs/teleop.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from mkdaemon.client.teleop.hands import DEFLECTED, Function, Lapse, PadHands
from mkdaemon.client.teleop.inputs import HandSticks, PadFacts
from mkdaemon.config.gamepad import Gamepad

RELEASE_AFTER: Final = 0.9
"""Time after the pad was last in order at which the aircraft is released [s]; the daemon would do it after 1.0 s."""
KINDS: Final[Mapping[Function, str]] = {Function.TAKEOFF: "takeoff", Function.HOLD: "hold", Function.LAND: "land"}
"""Setpoints that buttons stream, by the last word of their key."""
THRUST_MOVED: Final = 0.25
"""Share of its way by which a moved thrust stick takes over from a manoeuvre."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """One setpoint to stream.

    Attributes:
        kind: last word of its key `setpoint/<kind>`.
        fields: its own fields.
    """

    kind: str
    fields: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TeleopOutput:
    """What to do now.

    Attributes:
        setpoint: what to stream under the lease; None for nothing.
        let_go: the lease is given back now.
        reason: what is done and why, one sentence for a person.
        stop_motors: the user asks to stop the motors.
        is_neutral: the sticks are neutral because of a lapse.
    """

    setpoint: Wanted | None
    reason: str
    let_go: bool = False
    stop_motors: bool = False
    is_neutral: bool = False


class Teleop:
    """Any number of pads; one of them flies.

    Attributes:
        hands: every connected pad, by its name.
        pilot: name of the pad that flies; None while none does.
        manoeuvre: kind of the setpoint a button began; None while the sticks fly.
    """

    def __init__(self) -> None:
        self.hands: dict[str, PadHands] = {}
        self.pilot: str | None = None
        self.manoeuvre: str | None = None
        self._thrust_at = 0.0
        self._lost: str | None = None
        self._news = ""

    def attach(self, name: str, pad: Gamepad, facts: PadFacts, at: float) -> PadHands:
        """Take a pad that has come; it flies nothing before its state is known and its thrust stick was lowest."""
        self.hands[name] = PadHands(pad, facts, at)
        return self.hands[name]

    def detach(self, name: str, reason: str) -> None:
        """Forget a pad that is gone; the aircraft is released if it flew."""
        self.hands.pop(name, None)
        if name == self.pilot:
            self._lost = reason

    def ended(self, reason: str) -> None:
        """Take note that the lease has ended, or was refused; the enable button must be pressed again."""
        self.pilot = self.manoeuvre = None
        self._news = reason

    def refused(self) -> None:
        """Take note that the daemon refused what was streamed: a manoeuvre ends, and the sticks fly."""
        if self.pilot is not None and self.pilot in self.hands:
            self._end_manoeuvre(self.hands[self.pilot])

    def tick(self, now: float, *, is_engaged: bool, is_on_ground: bool | None = None) -> TeleopOutput:
        """Decide what is done now.

        Args:
            now: [s].
            is_engaged: the daemon sends what is streamed.
            is_on_ground: the aircraft is known to stand; None if unknown.
        """
        pressed = {name: hands.take_presses(now) for name, hands in self.hands.items()}
        if self._lost is not None:
            reason, self._lost = self._lost, None
            return self._let_go(reason)
        for name, functions in pressed.items():
            if Function.RELEASE in functions:
                return self._let_go(f"release pressed on {self.hands[name].facts.name}")
        if self.pilot is None:
            return self._wait(pressed, now, is_engaged=is_engaged, is_on_ground=is_on_ground)
        return self._fly(self.hands[self.pilot], pressed[self.pilot], now, is_engaged=is_engaged)

    def _let_go(self, reason: str) -> TeleopOutput:
        was_flying = self.pilot is not None
        self.ended(reason)
        return TeleopOutput(None, reason, let_go=was_flying)

    def _wait(
        self, pressed: Mapping[str, list[Function]], now: float, *, is_engaged: bool, is_on_ground: bool | None
    ) -> TeleopOutput:
        reasons = []
        for name, hands in self.hands.items():
            obstacle = hands.obstacle(pressed[name], now, is_on_ground=is_on_ground)
            if Function.STOP in pressed[name]:
                return TeleopOutput(None, "the motors are asked to stop", stop_motors=True)
            if Function.ENABLE in pressed[name] and not obstacle:
                self.pilot, self._news = name, ""
                return self._fly(hands, pressed[name], now, is_engaged=is_engaged)
            reasons.append(obstacle or f"hold {hands.pad.buttons.enable} of {hands.facts.name} to fly")
        waiting = "; ".join(dict.fromkeys(reasons)) or "no pad is there: plug one in"
        return TeleopOutput(None, f"{self._news}; {waiting}" if self._news else waiting)

    def _fly(self, hands: PadHands, pressed: list[Function], now: float, *, is_engaged: bool) -> TeleopOutput:
        lapse = hands.lapse(now)
        if lapse is not None:
            return self._lapsed(hands, lapse, now)
        stop = Function.STOP in pressed
        for function in pressed:
            self._begin(function, hands)
        if self._takes_over(hands):
            self._end_manoeuvre(hands)
        if self.manoeuvre is not None:
            fields = {"height": hands.pad.takeoff_height} if self.manoeuvre == "takeoff" else {}
            return TeleopOutput(
                Wanted(self.manoeuvre, fields), f"{self.manoeuvre}: move a stick to take over", stop_motors=stop
            )
        wish = hands.wish(is_engaged=is_engaged)
        return TeleopOutput(Wanted("stick", wish._asdict()), f"{hands.facts.name} flies", stop_motors=stop)

    def _lapsed(self, hands: PadHands, lapse: Lapse, now: float) -> TeleopOutput:
        self._end_manoeuvre(hands)
        if now - lapse.since >= RELEASE_AFTER:
            return self._let_go(lapse.reason)
        throttle = hands.thrust.value
        if lapse.is_input_lost:
            throttle = min(throttle, hands.thrust.hover)
        neutral = HandSticks(0.0, 0.0, 0.0, throttle)
        return TeleopOutput(Wanted("stick", neutral._asdict()), f"neutral: {lapse.reason}", is_neutral=True)

    def _begin(self, function: Function, hands: PadHands) -> None:
        """Begin a manoeuvre, if the button stands for one."""
        kind = KINDS.get(function)
        if kind is None:
            return
        self._thrust_at = hands.inputs.axis(hands.axes.throttle)
        self.manoeuvre = kind

    def _end_manoeuvre(self, hands: PadHands) -> None:
        """Let the sticks fly again, at hover thrust until the thrust stick has come to it."""
        if self.manoeuvre is not None:
            self.manoeuvre = None
            hands.thrust.hold(hands.thrust.hover)

    def _takes_over(self, hands: PadHands) -> bool:
        thrust = hands.inputs.axis(hands.axes.throttle)
        return hands.deflection() > DEFLECTED or abs(thrust - self._thrust_at) > THRUST_MOVED

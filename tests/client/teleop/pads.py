"""A pad for tests: an Xbox-like mapping with raw values as its driver gives them."""

from __future__ import annotations

from typing import Any

from mkdaemon.client.teleop.hands import PadHands
from mkdaemon.client.teleop.inputs import AxisRange, PadFacts
from mkdaemon.client.teleop.teleop import Teleop, TeleopOutput
from mkdaemon.config.gamepad import Gamepad

LOW, MIDDLE, HIGH = -32768, 0, 32767
STICKS = {"left_x": "ABS_X", "left_y": "-ABS_Y", "right_x": "ABS_RX", "right_y": "-ABS_RY"}
BUTTONS = {
    "enable": "BTN_TL",
    "fine": "BTN_TR",
    "thrust_lock": "BTN_SOUTH",
    "recentre": "BTN_WEST",
    "reset": "BTN_SELECT",
    "takeoff": "BTN_START",
    "hold": "BTN_NORTH",
    "land": "ABS_Z+",
    "release": "BTN_EAST",
    "stop": "BTN_MODE",
    "trim_left": "ABS_HAT0X-",
    "trim_right": "ABS_HAT0X+",
    "trim_forward": "ABS_HAT0Y-",
    "trim_back": "ABS_HAT0Y+",
}
REST = {"ABS_X": 0, "ABS_Y": 0, "ABS_RX": 0, "ABS_RY": 0, "ABS_Z": 0, "ABS_HAT0X": 0, "ABS_HAT0Y": 0}
FACTS = PadFacts(
    "Test pad",
    {
        **dict.fromkeys(("ABS_X", "ABS_Y", "ABS_RX", "ABS_RY"), AxisRange(LOW, HIGH)),
        "ABS_Z": AxisRange(0, 255),
        "ABS_HAT0X": AxisRange(-1, 1),
        "ABS_HAT0Y": AxisRange(-1, 1),
    },
    frozenset(name for name in BUTTONS.values() if name.startswith("BTN_")),
)


def gamepad(**changes: Any) -> Gamepad:
    """The mapping, with changes."""
    return Gamepad.model_validate({"name": "Test pad", "sticks": STICKS, "buttons": BUTTONS} | changes)


class TestedPad:
    """A pad and the teleop it is plugged into, with a clock of its own."""

    __test__ = False

    def __init__(
        self, facts: PadFacts = FACTS, teleop: Teleop | None = None, name: str = "pad", **changes: Any
    ) -> None:
        self.now = 10.0
        self.name = name
        self.state: dict[str, float] = dict(REST)
        self.state |= dict.fromkeys(facts.buttons, 0)
        self.teleop = teleop or Teleop()
        self.hands: PadHands = self.teleop.attach(name, gamepad(**changes), facts, self.now)
        self.is_engaged = True
        self.is_on_ground: bool | None = None

    def ask(self, **changes: float) -> None:
        """Let the pad answer, with changes to its state."""
        self.state |= changes
        self.hands.asked(self.state, self.now)

    def tick(self, seconds: float = 0.02, **changes: float) -> TeleopOutput:
        """Let time pass, ask the pad, and decide."""
        self.now += seconds
        self.ask(**changes)
        return self.decide()

    def decide(self, seconds: float = 0.0) -> TeleopOutput:
        """Let time pass without asking the pad, and decide."""
        self.now += seconds
        return self.teleop.tick(self.now, is_engaged=self.is_engaged, is_on_ground=self.is_on_ground)

    def make_ready(self) -> None:
        """Pull the thrust stick down and let it go."""
        self.tick()
        self.tick(ABS_Y=HIGH)
        self.tick(ABS_Y=MIDDLE)

    def fly(self) -> TeleopOutput:
        """Make it ready and hold the enable button."""
        self.make_ready()
        return self.tick(BTN_TL=1)

    def sticks(self, **changes: float) -> dict[str, float]:
        """What is streamed after these changes."""
        output = self.tick(**changes)
        assert kind(output) in ("stick", "neutral")
        return dict(output.setpoint.fields)


def flown_pad(*args: Any, **changes: Any) -> TestedPad:
    """A pad that flies."""
    pad = TestedPad(*args, **changes)
    pad.fly()
    return pad


def kind(output: TeleopOutput) -> str | None:
    """What is streamed: its kind, or `neutral` for sticks because of a lapse; None for nothing."""
    return "neutral" if output.is_neutral else output.setpoint and output.setpoint.kind

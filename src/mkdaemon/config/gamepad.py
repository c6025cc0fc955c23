"""The mapping of a gamepad: which of its axes and buttons does what, and how a stick feels. One file a pad."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from mkdaemon.config.base import Section

Id = Annotated[str, Field(pattern=r"^[0-9a-f]{4}:[0-9a-f]{4}$")]
Axis = Annotated[str, Field(pattern=r"^-?[A-Z][A-Z0-9_]{0,30}$")]
Press = Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]{0,30}[+-]?$")]

MOST_TRIM: Final = 20
"""Largest trim [stick]; the daemon's own neutral band is 4, its largest tilt command 60 (docs/configuration.md)."""


class SticksSection(Section):
    """Axes of a pad with two sticks; the stick mode says what each does. `-` in front where the axis grows downwards.

    Names are the kernel's, of input-event-codes.h; `evtest` shows those of a pad.
    """

    left_x: Axis
    """Left stick, right positive, for example "ABS_X"."""
    left_y: Axis
    """Left stick, up positive, for example "-ABS_Y"."""
    right_x: Axis
    """Right stick, right positive."""
    right_y: Axis
    """Right stick, up positive."""


class ChannelsSection(Section):
    """Axes of a transmitter used as a joystick, whose channels have their meaning already: the order AETR."""

    aileron: Axis
    """Roll, right positive."""
    elevator: Axis
    """Pitch, stick forward positive."""
    throttle: Axis
    """More lift positive."""
    rudder: Axis
    """Yaw, stick right positive."""


class ButtonsSection(Section):
    """Functions of buttons. An axis is a button with `+` or `-` behind its name, for example "ABS_HAT0X-", "ABS_Z+"."""

    enable: Press
    """The enable button: nothing is sent unless it is held; releasing it releases the aircraft."""
    fine: Press | None = None
    """Small deflections of pitch, roll and yaw, on and off."""
    thrust_lock: Press | None = None
    """The thrust stays as it is, on and off."""
    recentre: Press | None = None
    """The thrust of this moment becomes the middle of the thrust stick."""
    reset: Press | None = None
    """Trims, fine, thrust lock and the middle of the thrust stick as at the start."""
    takeoff: Press | None = None
    """Take off over the target in sight; hold it for half a second."""
    hold: Press | None = None
    """Stay over the target in sight; a stick that moves takes over again."""
    land: Press | None = None
    """Land on the target in sight; hold it for half a second."""
    release: Press | None = None
    """Release the aircraft at once."""
    stop: Press | None = None
    """Ask for the motors to stop, which few firmwares can; hold it for one second."""
    trim_forward: Press | None = None
    """One count of pitch trim, nose down."""
    trim_back: Press | None = None
    """One count of pitch trim, nose up."""
    trim_left: Press | None = None
    """One count of roll trim, left side down."""
    trim_right: Press | None = None
    """One count of roll trim, right side down."""


class AxisSection(Section):
    """Response of a stick."""

    rate: float = Field(default=30.0, gt=0, le=127)
    """Full deflection [stick]; the limiter of the daemon still applies."""
    expo: float = Field(default=0.3, ge=0, le=1)
    """Share of the cube in the curve: 0 is a straight line, more is softer about the middle."""
    deadzone: float = Field(default=0.08, ge=0, le=0.5)
    """Share of the way that counts as the middle."""
    trim: float = Field(default=0.0, ge=-MOST_TRIM, le=MOST_TRIM)
    """Added to the deflection [stick]."""


class ThrustSection(Section):
    """Throttle by the thrust stick [stick from the centre]: lowest, hover and highest at its low, middle and top."""

    lowest: float = Field(default=-100.0, ge=-127, le=127)
    """Stick at its lowest."""
    hover: float = Field(default=-2.0, ge=-127, le=127)
    """Stick in its middle: the throttle that carries the aircraft."""
    highest: float = Field(default=30.0, ge=-127, le=127)
    """Stick at its top."""
    expo: float = Field(default=0.4, ge=0, le=1)
    """As of the other axes."""
    deadzone: float = Field(default=0.08, ge=0, le=0.5)
    """As of the other axes; 0 for a stick without a spring."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not self.lowest < self.hover < self.highest:
            msg = f"lowest {self.lowest:g} < hover {self.hover:g} < highest {self.highest:g} does not hold"
            raise ValueError(msg)
        return self


class Gamepad(Section):
    """One kind of pad."""

    name: str = Field(min_length=1, max_length=60)
    """In words."""
    ids: tuple[Id, ...] = ()
    """USB or Bluetooth vendor and product, four hexadecimal digits each: "045e:028e"; none: chosen by `--mapping`."""
    sticks: SticksSection | None = None
    """Axes of two sticks; either these or `channels`."""
    channels: ChannelsSection | None = None
    """Axes with a meaning; either these or `sticks`."""
    mode: Literal[1, 2, 3, 4] = 2
    """Stick mode; in mode 2 the left stick is thrust and yaw. docs/teleop.md shows all."""
    buttons: ButtonsSection
    """What presses do."""
    pitch: AxisSection = AxisSection()
    """Forward and back."""
    roll: AxisSection = AxisSection()
    """To the sides."""
    yaw: AxisSection = AxisSection()
    """Turning."""
    thrust: ThrustSection = ThrustSection()
    """Up and down."""
    fine_scale: float = Field(default=0.35, gt=0, le=1)
    """Share of pitch, roll and yaw that is left while `fine` is on."""
    takeoff_height: float = Field(default=1.5, ge=0.5, le=10)
    """Of a take-off by button [m]."""
    quiet_after: float | None = Field(default=None, ge=0.5, le=60)
    """A pad with a deflected stick that reports nothing for this time counts as gone [s]. Unset: 2 s by radio
    (Bluetooth), never by cable. The kernel keeps the last values of a pad whose radio is out of reach."""

    @model_validator(mode="after")
    def _has_axes(self) -> Self:
        if (self.sticks is None) == (self.channels is None):
            msg = "give the axes either as [sticks] or as [channels]"
            raise ValueError(msg)
        return self

    @model_validator(mode="after")
    def _uses_each_once(self) -> Self:
        section = self.sticks or self.channels
        axes = [] if section is None else [axis.lstrip("-") for axis in section.model_dump().values()]
        pressed = [press for press in self.buttons.model_dump().values() if press is not None]
        for names, what in ((axes, "axis"), (pressed, "button")):
            double = next((name for name in names if names.count(name) > 1), None)
            if double is not None:
                msg = f"{what} {double} is used twice"
                raise ValueError(msg)
        return self

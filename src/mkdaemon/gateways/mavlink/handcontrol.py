"""The streams of ground stations: hand controllers and offboard setpoints, watched until one is asked to be flown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from mkdaemon.errors import CommandRejectedError
from mkdaemon.gateways.mavlink.dialect import Message
from mkdaemon.gateways.mavlink.modes import Mode
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.setpoints import (
    ON_THE_GLOBE,
    Axes,
    StreamedSetpoint,
    Unusable,
    attitude_target,
    axes_of_manual,
    axes_of_override,
    local_target,
    speeds,
    sticks,
)
from mkdaemon.gateways.mavlink.steering import STREAMED, By, ManualSteering
from mkdaemon.gateways.mavlink.texts import Notify, words_of
from mkdaemon.telemetry.control import ControlEstimate

MESSAGES: Final = frozenset(
    {
        *("MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "SET_POSITION_TARGET_LOCAL_NED", "SET_ATTITUDE_TARGET"),
        "SET_POSITION_TARGET_GLOBAL_INT",
    }
)
"""What is taken here."""
_MOST: Final = 64
"""Streams that are remembered."""
_BY_MODE: Final = {Mode.STABILIZED: sticks, Mode.POSITION: speeds}

_Value = TypeVar("_Value")


class HandControl:
    """Takes what ground stations stream."""

    def __init__(
        self, steering: ManualSteering, picture: LinkPicture, notify: Notify, now: Callable[[], float]
    ) -> None:
        """Watch streams.

        Args:
            steering: flies.
            picture: what is known.
            notify: tells a ground station why its setpoint is not flown.
            now: the clock [s].
        """
        self._steering, self._picture, self._notify, self._now = steering, picture, notify, now
        self._axes: dict[By, tuple[float, Axes]] = {}
        self._wanted: dict[By, tuple[float, StreamedSetpoint]] = {}

    def take(self, by: By, message: Message) -> None:
        """Take a message of a stream: hand it on where its program flies by it, else remember that it came."""
        name = message.get_type()
        if name in ("MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE"):
            axes = axes_of_manual(message) if name == "MANUAL_CONTROL" else axes_of_override(message)
            if axes is not None:
                self._take_axes(by, axes)
            return
        if name == "SET_ATTITUDE_TARGET":
            found = attitude_target(message)
        elif name == "SET_POSITION_TARGET_GLOBAL_INT":
            found = ON_THE_GLOBE
        else:
            found = local_target(message, self._picture.get(ControlEstimate))
        if isinstance(found, Unusable):
            self._notify(by.station, found.reason)
            return
        _remember(self._wanted, by, (self._now(), found))
        order = self._steering.order
        if order is not None and order.mode is Mode.OFFBOARD:
            self._hand_on(by, found)

    def _take_axes(self, by: By, axes: Axes) -> None:
        _remember(self._axes, by, (self._now(), axes))
        order = self._steering.order
        make = _BY_MODE.get(order.mode) if order is not None and order.mode is not None else None
        if make is not None:
            self._hand_on(by, make(axes))

    def _hand_on(self, by: By, wanted: StreamedSetpoint) -> None:
        try:
            self._steering.stream(by, wanted.kind, wanted.fields)
        except CommandRejectedError as refusal:
            self._notify(by.station, words_of(refusal))

    def streamed(self, by: By, mode: Mode) -> str | None:
        """What a program streams that a mode would fly, as the last word of a key; None where it streams nothing.

        Args:
            by: the program.
            mode: Stabilized and Position fly its sticks, Offboard its setpoints.
        """
        now = self._now()
        if mode is Mode.OFFBOARD:
            at, wanted = self._wanted.get(by, (-STREAMED, None))
            return wanted.kind if wanted is not None and now - at <= STREAMED else None
        since, axes = self._axes.get(by, (-STREAMED, None))
        make = _BY_MODE.get(mode)
        return make(axes).kind if make is not None and axes is not None and now - since <= STREAMED else None


def _remember(known: dict[By, tuple[float, _Value]], by: By, value: tuple[float, _Value]) -> None:
    if by not in known and len(known) >= _MOST:
        del known[min(known, key=lambda one: known[one][0])]
    known[by] = value

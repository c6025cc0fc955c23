"""Gamepads of another machine: `mkctl teleop --send` publishes one, `--joy` finds and reads it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final

from mkdaemon.cli.mkctl.teleop.devices import Device, DeviceLostError, DeviceState
from mkdaemon.cli.mkctl.teleop.padsearch import Mappings, attach
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.client import Sample, Vehicle
from mkdaemon.client.joy import PREFIX, JoySender
from mkdaemon.client.teleop.inputs import AxisRange, PadFacts
from mkdaemon.errors import ProtocolError
from mkdaemon.telemetry.joy import Joy

GONE: Final = 3.0
"""A pad that is silent for this time is gone [s]; its sticks are neutral after 0.25 s."""
PERIOD: Final = 0.02
"""Between two messages [s]."""


class JoyPad:
    """One pad of another machine.

    Attributes:
        name: its key.
        facts: what it says about itself.
        sequence: number of the newest message.
        refused: messages that were not signed, or old.
    """

    def __init__(self, pad: str, secret: str, first: Joy, now: float) -> None:
        """Take a pad from its first message, which is signed.

        Args:
            pad: last word of its key.
            secret: that its messages are signed with.
            first: the message.
            now: when it arrived [s].
        """
        self.name = f"{PREFIX}{pad}"
        ranges = dict.fromkeys(first.axis_names, AxisRange(-1.0, 1.0))
        self.facts = PadFacts(
            f"{first.name} of {pad}",
            ranges,
            frozenset(first.button_names),
            is_wireless=first.wireless,
            speaker=f"the machine of {pad}",
        )
        self._pad, self._secret = pad, secret
        self.refused = 0
        self.sequence = first.sequence
        self._state = _state_of(first, now)

    def take(self, joy: Joy, now: float) -> bool:
        """Take a message; one that is not signed, or not newer, is counted. Returns whether it was taken.

        Args:
            joy: the message.
            now: when it arrived [s].
        """
        if joy.sequence <= self.sequence or not joy.is_by(self._secret, self._pad):
            self.refused += 1
            return False
        self.sequence = joy.sequence
        self._state = _state_of(joy, now)
        return True

    def ask(self, now: float) -> DeviceState | None:
        """Return what came last, as old as it is.

        Raises:
            DeviceLostError: nothing came for too long.
        """
        if now - self._state.at > GONE:
            raise DeviceLostError(f"{self.facts.name} has been silent for {GONE:g} s")
        return self._state

    def alarm(self) -> None:
        """Nothing: the other machine watches the aircraft itself."""

    def let_go(self) -> None:
        """Do nothing: the enable button reports its own release."""

    def close(self) -> None:
        """Nothing is open."""


def _state_of(joy: Joy, now: float) -> DeviceState:
    values = dict(zip(joy.axis_names, joy.axes, strict=True))
    values |= dict(zip(joy.button_names, map(float, joy.buttons), strict=True))
    return DeviceState(values, now - joy.known_age)


def joy_fields(device: Device, id_: str, state: DeviceState, now: float) -> dict[str, Any]:
    """What is sent of a pad's state; axes as a share of their way.

    Args:
        device: the pad.
        id_: vendor and product.
        state: what it answered.
        now: [s].
    """
    ranges = device.facts.ranges
    axes = {name: ranges[name].normalise(value) for name, value in state.values.items() if name in ranges}
    buttons = {name: int(value) for name, value in state.values.items() if name not in ranges}
    return {
        "name": device.facts.name[:100],
        "id": id_,
        "wireless": device.facts.is_wireless,
        "known_age": max(now - state.at, 0.0),
        "axis_names": tuple(axes),
        "axes": tuple(axes.values()),
        "button_names": tuple(buttons),
        "buttons": tuple(buttons.values()),
    }


async def publish_pad(
    device: Device, id_: str, sender: JoySender, news: asyncio.Event, show: Callable[[str], None]
) -> None:
    """Send the state of a pad fifty times a second and at once after a change, until it is gone.

    Args:
        device: the pad.
        id_: vendor and product.
        sender: where to.
        news: is set when the pad reported something.
        show: shows a line.
    """
    loop = asyncio.get_running_loop()
    show(f"sends {device.facts.name}; Ctrl-C ends it")
    while True:
        now = loop.time()
        try:
            state = device.ask(now)
        except DeviceLostError as error:
            show(str(error))
            return
        if state is not None:
            sender.send(joy_fields(device, id_, state, now))
        try:
            async with asyncio.timeout(PERIOD):
                await news.wait()
        except TimeoutError:
            continue
        news.clear()
        await asyncio.sleep(PERIOD / 4)


async def look_for_joy(session: TeleopSession, uav: Vehicle, pad: str, secret: str, mappings: Mappings) -> None:
    """Follow one key for ever.

    Args:
        session: what flies.
        uav: the daemon's client.
        pad: last word of the key.
        secret: that messages are signed with.
        mappings: of pads.
    """
    finder = JoyFinder(session, pad, secret, mappings)
    async with uav.watch(f"{PREFIX}{pad}") as samples:
        async for sample in samples:
            finder.take(sample)


class JoyFinder:
    """Brings messages of one key to the session.

    Args:
        session: what flies.
        pad: last word of the key.
        secret: that messages are signed with.
        mappings: of pads.
    """

    def __init__(self, session: TeleopSession, pad: str, secret: str, mappings: Mappings) -> None:
        self._session, self._pad, self._secret, self._mappings = session, pad, secret, mappings
        self._device: JoyPad | None = None

    def take(self, sample: Sample) -> None:
        """Take a message; an invalid or unsigned one is reported and changes nothing."""
        try:
            joy = sample.value
        except ProtocolError as error:
            self._session.notice = str(error)
            return
        now = self._session.now
        device = self._device
        if device is not None and device.name in self._session.devices:
            if isinstance(joy, Joy) and device.take(joy, now):
                self._session.reported(device.name, "", 0.0, now)
        elif isinstance(joy, Joy):
            self._attach(joy, now)

    def _attach(self, joy: Joy, now: float) -> None:
        if not joy.is_by(self._secret, self._pad):
            self._session.notice = f"{PREFIX}{self._pad}: not signed with this program's secret"
        elif self._device is None or joy.sequence > self._device.sequence:
            device = JoyPad(self._pad, self._secret, joy, now)
            if attach(self._session, device, joy.id, self._mappings):
                self._device = device

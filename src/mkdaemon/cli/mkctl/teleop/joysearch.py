"""Pads of other machines: attached with their first signed message, fed with what follows."""

from __future__ import annotations

from mkdaemon.cli.mkctl.teleop.joypad import JoyPad
from mkdaemon.cli.mkctl.teleop.padsearch import Mappings
from mkdaemon.cli.mkctl.teleop.session import Session
from mkdaemon.client import Sample, Vehicle
from mkdaemon.client.joy import PREFIX
from mkdaemon.errors import ConfigError, ProtocolError
from mkdaemon.telemetry.joy import Joy


async def look_for_joy(session: Session, uav: Vehicle, pad: str, secret: str, mappings: Mappings) -> None:
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

    def __init__(self, session: Session, pad: str, secret: str, mappings: Mappings) -> None:
        self._session, self._pad, self._secret, self._mappings = session, pad, secret, mappings
        self._device: JoyPad | None = None

    def take(self, sample: Sample) -> None:
        """Take a message; what is none, or not signed, is told of and changes nothing."""
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
            return
        last = -1 if self._device is None else self._device.sequence
        if joy.sequence <= last:
            return
        try:
            mapping = self._mappings.of(joy.id, joy.name)
        except ConfigError as error:
            self._session.notice = str(error)
            return
        self._device = JoyPad(self._pad, self._secret, joy, now)
        self._session.attach(self._device, mapping)

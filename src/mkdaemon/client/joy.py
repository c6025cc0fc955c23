"""A gamepad's state on the bus, for a program on another machine that flies by it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from mkdaemon.client.transport import Transport
from mkdaemon.clock import Clock

PREFIX: Final = "joy/"


class JoySender:
    """Publishes the state of one pad under `joy/<pad>`.

    Attributes:
        sequence: number of the last message.
    """

    def __init__(self, transport: Transport, pad: str, secret: str) -> None:
        """Make a publisher.

        Args:
            transport: the daemon's client.
            pad: last word of the key.
            secret: that the program that flies shows.
        """
        self._publisher = transport.stream(f"{PREFIX}{pad}")
        self._pad, self._secret = pad, secret
        self._clock = Clock()
        self.sequence = 0

    def send(self, fields: Mapping[str, Any]) -> None:
        """Sign a state and put it.

        Args:
            fields: of `mkdaemon.telemetry.joy.Joy`, without stamp, sequence and proof.
        """
        from mkdaemon.bus.codec import encode, encoding_of
        from mkdaemon.telemetry.joy import Joy

        self.sequence += 1
        stamp = self._clock.stamp()
        # Begins above the last one of an earlier program of this pad, which must not be taken for a replay.
        joy = Joy(stamp=stamp, sequence=int(stamp.wall * 1000) * 1000 + self.sequence, **fields)
        self._publisher.put(encode(joy.signed(self._secret, self._pad)), encoding=encoding_of(Joy))

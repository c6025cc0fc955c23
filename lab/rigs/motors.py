"""What a link without a flight core needs: who knows whether the motors run."""

from __future__ import annotations

from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.link.session.traffic import LinkSink, Lost, Received, Sent
from mkdaemon.protocol.boards import board_at
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.telemetry.link import LinkHealth, LinkState, LinkTraffic
from mkdaemon.translate.state import motors_running


class MotorWatch:
    """A sink that passes everything on and remembers what telemetry says about the motors.

    Attributes:
        facts: what is known; `facts.motors_running` is what the link asks.
    """

    def __init__(self, sink: LinkSink) -> None:
        self.facts = VehicleMemory()
        self._sink = sink

    def received(self, frame: Received) -> None:
        """Take a right frame."""
        board = board_at(frame.frame.address)
        if board is not None and not isinstance(frame.message, Unknown):
            running = motors_running(board.word, frame.message)
            if running is not None:
                self.facts.motors_reported(running, frame.at)
        self._sink.received(frame)

    def sent(self, frame: Sent) -> None:
        """Pass a transmission on."""
        self._sink.sent(frame)

    def dropped(self, loss: Lost) -> None:
        """Pass a loss on."""
        self._sink.dropped(loss)

    def state_changed(self, state: LinkState) -> None:
        """Take a verdict on the line."""
        self.facts.link_changed(state)
        self._sink.state_changed(state)

    def health_measured(self, health: LinkHealth) -> None:
        """Pass the measurements on."""
        self._sink.health_measured(health)

    def stream_ended(self, key: str) -> None:
        """Pass the end of a stream of another program on."""
        self._sink.stream_ended(key)

    def traffic_counted(self, traffic: LinkTraffic) -> None:
        """Pass the counters on."""
        self._sink.traffic_counted(traffic)

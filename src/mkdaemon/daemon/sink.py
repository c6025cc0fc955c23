"""From the line to the bus: every frame as bytes, as a message, and as what it says about the aircraft."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pydantic import BaseModel

from mkdaemon.clock import Clock
from mkdaemon.control.events import (
    Feed,
    FlightctrlReported,
    FrameConfirmed,
    FrameSent,
    LinkMeasured,
    LinkVerdict,
    MotorsReported,
    StateValue,
)
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.link.session.traffic import Lost, Purpose, Received, Sent
from mkdaemon.protocol.boards import board_at
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.messages import ControlConfirm
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkState, LinkTraffic
from mkdaemon.telemetry.state import Altitude, Attitude
from mkdaemon.telemetry.traffic import FrameSample, RawFrame
from mkdaemon.translate import StateTranslator
from mkdaemon.translate.origin import State
from mkdaemon.translate.state import fc_is_lost, motors_running

_FOREIGN: Final = "other"
"""Board chunk of a frame whose address no board has."""


class BusSink:
    """Hears about the line and publishes; every method returns at once."""

    def __init__(
        self,
        bus: Outlet,
        feed: Feed,
        facts: VehicleFacts,
        audit: Audit,
        eyes: Eyes,
        clock: Clock,
        tilted: Callable[[Attitude], None] = lambda attitude: None,
    ) -> None:
        """Hand everything on.

        Args:
            bus: where values go.
            feed: tells the flight core, before the bus hears of it.
            facts: what is known about the vehicle.
            audit: hears of a new condition of the line.
            eyes: hear how the vehicle lies.
            clock: stamps.
            tilted: hears the attitude of the vehicle.
        """
        self._bus = bus
        self._feed, self._facts = feed, facts
        self._audit = audit
        self._eyes = eyes
        self._clock, self._tilted = clock, tilted
        self._translator = StateTranslator()
        self._counts = {"rx": 0, "tx": 0}

    def received(self, frame: Received) -> None:
        """Tell the flight core what a frame says, then publish it as bytes, as a message and as state."""
        sequence = self._count("rx")
        stamp = self._clock.stamp(frame.at)
        board = board_at(frame.frame.address)
        word = _FOREIGN if board is None else board.word
        message = frame.message
        states = [] if isinstance(message, Unknown) else self._pass_to_core(word, message, stamp)
        self._bus.publish("raw/rx", RawFrame(stamp=stamp, sequence=sequence, raw=frame.frame.raw))
        sample, schema = _sample(message, word, frame.frame.id, sequence, stamp)
        self._bus.publish(f"rx/{word}/{_key(message)}", sample, schema=schema)
        for suffix, value in states:
            self._bus.publish(suffix, value)

    def _pass_to_core(self, board: str, message: WireMessage, stamp: Stamp) -> list[State]:
        """Tell the flight core and the cameras what a message says; returns its state values."""
        at = stamp.monotonic
        if isinstance(message, ControlConfirm):
            self._feed(FrameConfirmed(message.frame), at)
        lost = fc_is_lost(message)
        if lost is not None:
            self._feed(FlightctrlReported(lost), at)
        running = motors_running(board, message)
        if running is not None:
            self._feed(MotorsReported(running), at)
        states = self._translator.states(board, message, stamp)
        for _, value in states:
            self._feed(StateValue(value), at)
            if isinstance(value, Attitude):
                self._eyes.attitude_received(value)
                self._tilted(value)
            elif isinstance(value, Altitude):
                self._eyes.altitude_received(value)
        return states

    def sent(self, frame: Sent) -> None:
        """Publish a transmission as bytes and as a message; report stick frames to the flight core."""
        if frame.purpose is Purpose.SETPOINT and frame.message is not None:
            self._feed(FrameSent(frame.message.frame), frame.at)  # type: ignore[attr-defined]  # every layout has it
        sequence = self._count("tx")
        stamp = self._clock.stamp(frame.at)
        purpose = frame.purpose.name.lower()
        self._bus.publish("raw/tx", RawFrame(stamp=stamp, sequence=sequence, raw=frame.raw, purpose=purpose))
        message = frame.message
        if message is None:
            return
        board = _addressee(frame.raw)
        word = _FOREIGN if board is None else board.word
        sample, schema = _sample(message, word, message.spec.id, sequence, stamp, purpose=purpose)
        self._bus.publish(f"tx/{word}/{message.spec.key}", sample, schema=schema)

    def dropped(self, loss: Lost) -> None:
        """Publish bytes that did not get through, and why."""
        raw = RawFrame(
            stamp=self._clock.stamp(loss.at),
            sequence=self._count(loss.direction),
            raw=loss.raw,
            dropped=loss.reason.value,
        )
        self._bus.publish(f"raw/{loss.direction}", raw)

    def state_changed(self, state: LinkState) -> None:
        """Publish the verdict on the line; a new condition is also a line in the log, with what to do about it."""
        before = self._facts.link
        if before is None or before.condition != state.condition:
            is_ordinary = state.condition in {LinkCondition.UP, LinkCondition.CLOSED}
            level = "info" if is_ordinary else "warning"
            self._audit.log(level, f"{state.port}: {state.condition.value}: {state.reason}")
        self._feed(LinkVerdict(state), state.stamp.monotonic)
        self._bus.publish("link/state", state)

    def health_measured(self, health: LinkHealth) -> None:
        """Publish the measurements; the checks before a flight look at them."""
        self._feed(LinkMeasured(health), health.stamp.monotonic)
        self._bus.publish("link/health", health)

    def stream_ended(self, key: str) -> None:
        """Say in the log that a stream of another program is ended."""
        self._audit.log("warning", f"stream {key}: this daemon did not request it; another program left it on; stopped")

    def traffic_counted(self, traffic: LinkTraffic) -> None:
        """Publish the counters."""
        self._bus.publish("link/traffic", traffic)

    def _count(self, direction: str) -> int:
        self._counts[direction] += 1
        return self._counts[direction]


def _key(message: WireMessage | Unknown) -> str:
    return "unknown" if isinstance(message, Unknown) else message.spec.key


def _addressee(raw: bytes) -> Board | None:
    start = raw.find(b"#")
    return board_at(raw[start + 1] - 0x61) if 0 <= start < len(raw) - 1 else None


def _sample(
    message: WireMessage | Unknown,
    board: str,
    letter: str,
    sequence: int,
    stamp: Stamp,
    *,
    purpose: str | None = None,
) -> tuple[FrameSample, type[BaseModel]]:
    """A message in its envelope, and the model that describes it."""
    if isinstance(message, Unknown):
        name, layout = "unknown", None
        schema: type[BaseModel] = FrameSample
        fields: object = {"payload": message.payload, "reason": message.reason}
    else:
        name, layout, schema, fields = message.spec.name, message.spec.layout, type(message), message
    sample = FrameSample(
        stamp=stamp,
        sequence=sequence,
        board=board,
        id=letter,
        message=name,
        layout=layout,
        fields=fields,
        purpose=purpose,
    )
    return sample, schema

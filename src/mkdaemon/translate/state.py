"""Wire messages to the aircraft's state in SI units."""

from __future__ import annotations

from mkdaemon.protocol.errorcodes import is_fc_lost
from mkdaemon.protocol.flags import FlightStatus, OsdStatus2
from mkdaemon.protocol.messages import (
    AttitudeDataFc210,
    AttitudeDataFcOld,
    AttitudeDataNc,
    AttitudeDataNcSticks,
    DebugDataFc,
    OsdData4,
    OsdData5,
)
from mkdaemon.protocol.messages.osdsets import OsdFlags, OsdSet
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.state import Altitude, AngleScale, Battery
from mkdaemon.translate.geometry import attitude
from mkdaemon.translate.origin import Origin, State
from mkdaemon.translate.osd import STICK_CENTRE, from_osd, pilot
from mkdaemon.translate.osdsets import SetTranslator

COARSE_AFTER = 0.5
"""Attitude of a degree's resolution (OSD) is published once the attitude stream is this old [s]."""

# Source: docs/protocol.md, "Debug channels of the FlightCtrl".
_CHANNEL_VOLTAGE, _CHANNEL_RECEIVER, _CHANNEL_CURRENT, _CHANNEL_CAPACITY = 9, 10, 22, 23
_CHANNEL_HEIGHT = 5
_CHANNEL_THROTTLE, _THROTTLE_SCALE = 7, 4.0
_CHANNEL_MOTORS = slice(12, 16)
_CHANNEL_FORK_STICK, _CHANNEL_FORK_GATE, _CHANNEL_FORK_CALIBRATED = 19, 25, 26
"""Of a public fork: the throttle stick itself, whether the gate is open, and whether it is calibrated, as all are whose
motors run. Stock firmware leaves them at 0."""


class StateTranslator:
    """Translates one aircraft's messages; remembers only what one message says and another needs."""

    def __init__(self) -> None:
        self._fine_attitude_at = float("-inf")
        self._sets = SetTranslator()
        self._fc_is_lost = False

    def states(self, board: str, message: WireMessage, stamp: Stamp) -> list[State]:
        """Return what a message says about the aircraft, keys without `mk/<vehicle>/`; often nothing.

        Args:
            board: who sent it, as in keys.
            message: decoded.
            stamp: when its last byte arrived.
        """
        origin = Origin(stamp, f"{board}/{message.spec.key}")
        lost = fc_is_lost(message)
        self._fc_is_lost = self._fc_is_lost if lost is None else lost
        if board == "nc" and self._fc_is_lost and message.spec.key == AttitudeDataNc.spec.key:
            return []  # the NaviCtrl repeats the last attitude it heard of
        match message:
            case AttitudeDataFc210() | AttitudeDataFcOld():
                self._fine_attitude_at = stamp.monotonic
                return _from_attitude(message, origin, AngleScale.FLIGHTCTRL)
            case AttitudeDataNc() | AttitudeDataNcSticks():
                self._fine_attitude_at = stamp.monotonic
                return _from_attitude(message, origin, AngleScale.STICKS)
            case OsdData4() | OsdData5():
                self._sets.receiver.look(message.error_code)
                states = from_osd(message, origin, self._sets.receiver)
                if self._wants_coarse(stamp.monotonic):
                    states.append(_coarse_attitude(message, origin))
                return states
            case DebugDataFc() if board == "fc":
                return _from_debug(message, origin)
            case OsdSet():
                states = self._sets.states(message, origin)
                coarse = self._sets.attitude(message, origin)
                if coarse is not None and self._wants_coarse(stamp.monotonic):
                    states.append(coarse)
                return states
        return []

    def _wants_coarse(self, now: float) -> bool:
        return not self._fc_is_lost and now - self._fine_attitude_at > COARSE_AFTER


def fc_is_lost(message: WireMessage) -> bool | None:
    """Whether a NaviCtrl says that it does not hear its FlightCtrl; None where a message says nothing about it."""
    match message:
        case OsdData4() | OsdData5() | OsdFlags():
            return is_fc_lost(message.error_code)
    return None


def motors_running(board: str, message: WireMessage) -> bool | None:
    """Whether a message says that motors run; None where it says nothing about it, or shows old flags."""
    if fc_is_lost(message):
        return None
    match message:
        case OsdData4() | OsdData5():
            return bool(message.fc_flags & FlightStatus.MOTORS_RUNNING)
        case OsdFlags():
            return bool(message.status_2 & OsdStatus2.MOTORS_RUNNING)
        case DebugDataFc() if board == "fc":
            return any(message.analog[_CHANNEL_MOTORS])
    return None


def _coarse_attitude(osd: OsdData4 | OsdData5, origin: Origin) -> State:
    value = attitude(origin, roll=osd.si("roll"), pitch=osd.si("pitch"), heading=osd.si("heading"))
    return "state/attitude", value


def _from_attitude(message: WireMessage, origin: Origin, scale: AngleScale) -> list[State]:
    angles = {name: message.si(name) for name in ("roll", "pitch", "heading")}
    return [("state/attitude", attitude(origin, **angles, scale=scale))]


def _from_debug(debug: DebugDataFc, origin: Origin) -> list[State]:
    """Battery, receiver and height where no NaviCtrl tells them."""
    channels = debug.analog
    battery = Battery(
        **origin._asdict(),
        voltage=channels[_CHANNEL_VOLTAGE] / 10,
        current=channels[_CHANNEL_CURRENT] / 10,
        used_mah=float(channels[_CHANNEL_CAPACITY]),
        is_low=None,
    )
    is_fork = bool(channels[_CHANNEL_FORK_CALIBRATED])
    stick = channels[_CHANNEL_FORK_STICK] + STICK_CENTRE if is_fork else channels[_CHANNEL_THROTTLE] / _THROTTLE_SCALE
    reported = pilot(
        origin,
        float(channels[_CHANNEL_RECEIVER]),
        sticks=None,
        throttle=None,
        gas=stick if any(channels[_CHANNEL_MOTORS]) else None,
        compensated_at=None if is_fork else battery.voltage,
        is_gate_open=bool(channels[_CHANNEL_FORK_GATE]) if is_fork else None,
    )
    return [
        ("state/battery", battery),
        ("state/altitude", Altitude(**origin._asdict(), above_start=channels[_CHANNEL_HEIGHT] / 10)),
        ("state/pilot", reported),
    ]

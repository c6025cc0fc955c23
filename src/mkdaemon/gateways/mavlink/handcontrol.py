"""The streams of ground stations, hand controllers and offboard setpoints: watched until one is asked to be flown.

What they send becomes setpoints of the daemon: sticks, velocities, positions, attitudes. Local frames are those of the
target in sight (`frames`); `BODY` frames are forward, right, down of the aircraft, turned level.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.errors import MkError
from mkdaemon.frames import euler_from_rotation, rotation_from_quaternion, wrap_angle
from mkdaemon.gateways.mavlink.dialect import UINT16_UNKNOWN, Message, mavlink
from mkdaemon.gateways.mavlink.frames import Vector3, compass_from_yaw, frd_from_flu, ned_from_enu
from mkdaemon.gateways.mavlink.modes import Mode
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.stations import By, Take
from mkdaemon.gateways.mavlink.steering import STREAMED, ManualSteering
from mkdaemon.gateways.mavlink.telemetry import STICK_US
from mkdaemon.gateways.mavlink.texts import Notify, words_of
from mkdaemon.telemetry.control import ControlEstimate

FULL: Final = 1000.0
"""Full deflection of an axis of MANUAL_CONTROL."""
TILT: Final = 60.0
"""Pitch, roll and yaw of a full deflection [stick]: the largest that the daemon's limiter passes as configured."""
THROTTLE: Final = 127.0
"""Throttle of a full deflection [stick from the centre]."""
SPEED: Final = 1.0
"""Velocity of a full deflection in Position mode [m/s]; the autopilot's own limits apply as well."""
CLIMB: Final = 0.5
"""The same up and down [m/s]."""
TURN: Final = 1.0
"""Yaw rate of a full deflection [rad/s]."""
_YAW_GAIN: Final = 1.0
"""Yaw rate per radian of heading error, where a velocity comes with a heading [1/s]."""
_YAW_LIMIT: Final = 0.5
"""Largest of those rates [rad/s]."""

_POSITION: Final = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_VELOCITY: Final = (
    mavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VZ_IGNORE
)
_YAW: Final = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_YAW_RATE: Final = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
_OFFSET: Final = int(mavlink.MAV_FRAME_LOCAL_OFFSET_NED)
_FRAMES: Final[dict[int, tuple[str, Callable[[Vector3], Vector3], Callable[[float], float]]]] = {
    **dict.fromkeys(
        (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD, _OFFSET), ("pad", ned_from_enu, compass_from_yaw)
    ),
    **dict.fromkeys(
        (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED, mavlink.MAV_FRAME_BODY_FRD),
        ("body", frd_from_flu, lambda yaw: wrap_angle(-yaw)),
    ),
}
"""Frames that can be flown: the daemon's word, and how a vector and a heading of them are turned into its axes."""


@dataclass(frozen=True, slots=True)
class StreamedSetpoint:
    """A setpoint of the daemon.

    Attributes:
        kind: last word of its key.
        fields: without epoch and sequence.
    """

    kind: str
    fields: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Axes:
    """The four axes of a hand controller, each -1 to 1.

    Attributes:
        forward: stick forward positive.
        right: stick right positive.
        up: more thrust positive; -1 is none.
        clockwise: stick right positive.
    """

    forward: float
    right: float
    up: float
    clockwise: float


def axes_of_manual(message: Message) -> Axes | None:
    """The axes of MANUAL_CONTROL; None where one of them is not used.

    Thrust is 0 to 1000, as PX4 and ArduPilot read it, and r is positive to the right, as every ground station sends it,
    though the description of the message says the opposite.
    """
    parts = (message.x, message.y, message.z, message.r)
    if any(not -FULL <= part <= FULL for part in parts):
        return None
    x, y, z, r = (part / FULL for part in parts)
    return Axes(x, y, min(max(2.0 * z - 1.0, -1.0), 1.0), r)


def axes_of_override(message: Message) -> Axes | None:
    """The axes of RC_CHANNELS_OVERRIDE in the order roll, pitch, throttle, yaw; None without a throttle.

    A channel that is not overridden is in its middle: the pilot's own stick is added by the FlightCtrl.
    """
    channels = (message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw)
    if channels[2] in (0, UINT16_UNKNOWN):
        return None
    if any(raw not in (0, UINT16_UNKNOWN) and not 800 <= raw <= 2200 for raw in channels):
        return None
    sides = [0.0 if raw in (0, UINT16_UNKNOWN) else (raw - 1500) / STICK_US / THROTTLE for raw in channels]
    roll, pitch, throttle, yaw = (min(max(side, -1.0), 1.0) for side in sides)
    return Axes(-pitch, roll, throttle, yaw)


def sticks(axes: Axes) -> StreamedSetpoint:
    """The axes as stick offsets."""
    return StreamedSetpoint(
        "stick",
        {
            "pitch": TILT * axes.forward,
            "roll": TILT * axes.right,
            "yaw": -TILT * axes.clockwise,
            "throttle": THROTTLE * axes.up,
        },
    )


def speeds(axes: Axes) -> StreamedSetpoint:
    """The axes as a velocity against the target in sight."""
    velocity = (SPEED * axes.forward, -SPEED * axes.right, CLIMB * axes.up)
    return StreamedSetpoint("velocity", {"velocity": velocity, "frame": "body", "yaw_rate": -TURN * axes.clockwise})


def local_target(message: Message, estimate: ControlEstimate | None) -> StreamedSetpoint:
    """A SET_POSITION_TARGET_LOCAL_NED; of one with position and velocity the position is flown.

    Args:
        message: as it came.
        estimate: estimated position of the aircraft; None while it is not flown.

    Raises:
        MkError: it cannot be flown; says what can.
    """
    mask, frame = message.type_mask, message.coordinate_frame
    if mask & mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET:
        raise MkError("forces cannot be flown: send positions or velocities")
    if not mask & _POSITION:
        kind, used = "position", (message.x, message.y, message.z)
    elif not mask & _VELOCITY:
        kind, used = "velocity", (message.vx, message.vy, message.vz)
    else:
        raise MkError("accelerations alone cannot be flown: send positions or velocities, all three axes")
    yaw = None if mask & _YAW else message.yaw
    rate = None if mask & _YAW_RATE else message.yaw_rate
    if not all(math.isfinite(value) for value in (*used, yaw or 0.0, rate or 0.0)):
        raise MkError("a setpoint has NaN in a field that its mask enables")
    if frame not in _FRAMES:
        raise MkError(f"frame {frame} cannot be flown: LOCAL_NED, LOCAL_OFFSET_NED, LOCAL_FRD and BODY_FRD can")
    word, turned, headed = _FRAMES[frame]
    vector, heading = turned(used), None if yaw is None else headed(yaw)
    if kind == "position":
        if frame == _OFFSET:
            if estimate is None:
                raise MkError("an offset needs a flight by the target first: send LOCAL_NED")
            east, north, up = (a + b for a, b in zip(estimate.position, vector, strict=True))
            vector = (east, north, up)
        return StreamedSetpoint(kind, {"position": vector, "frame": word, "yaw": heading})
    turn = 0.0 if rate is None else -rate
    if rate is None and heading is not None and estimate is not None and word == "pad":
        turn = min(max(_YAW_GAIN * wrap_angle(heading - estimate.yaw), -_YAW_LIMIT), _YAW_LIMIT)
    return StreamedSetpoint(kind, {"velocity": vector, "frame": word, "yaw_rate": _turn(turn)})


def _turn(rate: float) -> float:
    return min(max(rate, -math.pi), math.pi)


def attitude_target(message: Message) -> StreamedSetpoint:
    """A SET_ATTITUDE_TARGET: roll, pitch, yaw rate and thrust, of which a half carries the aircraft.

    The heading of its quaternion is not flown: no setpoint of the daemon has one.

    Raises:
        MkError: it cannot be flown; says why.
    """
    mask = message.type_mask
    if mask & (mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE | mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE):
        raise MkError("an attitude target needs attitude and thrust: rates alone cannot be flown")
    rate = 0.0 if mask & mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE else message.body_yaw_rate
    norm = math.hypot(*message.q)
    if not (math.isfinite(norm) and norm > 0.1 and math.isfinite(rate) and 0.0 <= message.thrust <= 1.0):
        raise MkError("an attitude target has no quaternion, or a thrust outside 0 to 1")
    roll, pitch, _ = euler_from_rotation(rotation_from_quaternion(tuple(message.q)))
    fields = {"roll": roll, "pitch": -pitch, "yaw_rate": _turn(-rate), "thrust": 2.0 * message.thrust}
    return StreamedSetpoint("attitude", fields)


_MOST: Final = 128
"""Streams that are remembered, each in each of its modes."""


class HandControl:
    """Takes what ground stations stream.

    Attributes:
        takes: what takes a message, by its name.
    """

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
        self._steering, self._notify, self._now = steering, notify, now
        self.takes: dict[str, Take] = {
            "MANUAL_CONTROL": self._taker(lambda message: _by_hand(axes_of_manual(message))),
            "RC_CHANNELS_OVERRIDE": self._taker(lambda message: _by_hand(axes_of_override(message))),
            "SET_ATTITUDE_TARGET": self._taker(lambda message: {Mode.OFFBOARD: attitude_target(message)}),
            "SET_POSITION_TARGET_GLOBAL_INT": self._taker(_on_the_globe),
            "SET_POSITION_TARGET_LOCAL_NED": self._taker(
                lambda message: {Mode.OFFBOARD: local_target(message, picture.get(ControlEstimate))}
            ),
        }
        self._streams: dict[tuple[By, Mode], tuple[float, StreamedSetpoint]] = {}

    def _taker(self, read: Callable[[Message], _Wanted]) -> Take:
        """Take what a message is in each mode: remember it, and hand it on where its program flies in that mode."""

        def take(by: By, message: Message) -> None:
            try:
                for mode, setpoint in read(message).items():
                    self._remember((by, mode), setpoint)
                    order = self._steering.order
                    if order is not None and order.mode is mode:
                        self._steering.stream(by, setpoint.kind, setpoint.fields)
            except MkError as refusal:
                self._notify(by.station, words_of(refusal))

        return take

    def _remember(self, key: tuple[By, Mode], setpoint: StreamedSetpoint) -> None:
        streams = self._streams
        if key not in streams and len(streams) >= _MOST:
            del streams[min(streams, key=lambda one: streams[one][0])]
        streams[key] = (self._now(), setpoint)

    def streamed(self, by: By, mode: Mode) -> str | None:
        """What a program streams that a mode would fly, as the last word of a key; None where it streams nothing.

        Args:
            by: the program.
            mode: Stabilized and Position fly its sticks, Offboard its setpoints.
        """
        at, setpoint = self._streams.get((by, mode), (-math.inf, None))
        return None if setpoint is None or self._now() - at > STREAMED else setpoint.kind


_Wanted = dict[Mode, StreamedSetpoint]
"""What a message is in each mode that flies it."""


def _on_the_globe(_: Message) -> _Wanted:
    """A SET_POSITION_TARGET_GLOBAL_INT, which is not flown: the NaviCtrl stores one target, it follows no stream."""
    raise MkError("a stream of places on the globe cannot be flown: DO_REPOSITION, or LOCAL_NED")


def _by_hand(axes: Axes | None) -> _Wanted:
    """What the axes of a hand controller are in each mode that flies them."""
    return {} if axes is None else {Mode.STABILIZED: sticks(axes), Mode.POSITION: speeds(axes)}

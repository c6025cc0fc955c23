"""The last pure function before the wire: range, slew, age, no NaN, no stick gesture.

It imports no controller and trusts none: whatever asks, nothing outside these bounds leaves the daemon.
Source of the rules: docs/safety.md, "The output limiter".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

from mkdaemon.config.control import LimiterConfig

LONGEST_STEP: Final = 0.1
"""Slew counts at most this much time [s]: a loop that stood still must not jump when it wakes."""

GESTURE_LOW: Final = -100.0
"""Throttle below this together with much yaw starts and stops motors, in flight too [stick]; docs/protocol.md,
"Starting and stopping motors"."""
GESTURE_YAW: Final = 70.0
"""Most yaw at any throttle [stick]: every gesture (start, stop, calibrate) wants more than 75, and the pilot's trim is
added. Our own throttle says nothing here, because stock firmware takes the smaller of the pilot's and ours;
docs/protocol.md, "Starting and stopping motors", and docs/firmware-notes.md, section 6."""


class Sticks(NamedTuple):
    """Stick offsets [stick; FLU]: pitch + nose down, roll + right side down, yaw + nose left, throttle + lift."""

    pitch: float
    roll: float
    yaw: float
    throttle: float


class StickCounts(NamedTuple):
    """The same as whole counts, ready for the wire [stick; FLU]."""

    pitch: int
    roll: int
    yaw: int
    throttle: int


@dataclass(frozen=True, slots=True)
class StickRange:
    """Range of one layout of external control.

    Attributes:
        tilt: largest pitch, roll and yaw [stick].
        lowest: smallest throttle [stick from the centre].
        highest: largest throttle [stick from the centre].
    """

    tilt: int
    lowest: int
    highest: int


RANGES: Final[Mapping[str, StickRange]] = MappingProxyType(
    {
        "v1": StickRange(127, -127, 127),  # throttle is 0..255 on the wire; 128 is no stick position
        "v2": StickRange(127, -127, 127),
        "v3": StickRange(127, -127, 127),
    }
)
"""Per layout; a test compares them with the message declarations."""


def limit(
    wanted: Sticks,
    last: Sticks,
    *,
    age: float,
    ttl: float,
    dt: float,
    layout: str,
    cfg: LimiterConfig,
    throttle_cap: float | None = None,
    hover: float | None = None,
) -> Sticks:
    """Bound a stick command before it may reach the wire.

    Args:
        wanted: what a client or controller asks for [stick; FLU].
        last: what this function returned one step earlier [stick; FLU].
        age: time since the setpoint behind `wanted` arrived [s].
        ttl: time that setpoint claims to hold [s]; never more than `cfg.setpoint_ttl` is granted.
        dt: time since `last` [s].
        layout: layout of external control, `v1`, `v2` or `v3`.
        cfg: bounds.
        throttle_cap: the pilot's throttle where it is known, or the last one on the ground [stick]; bounds the
            throttle of a stale command.
        hover: throttle that carries the aircraft by the estimate [stick]; the configured one where there is none.

    Returns:
        `wanted` clipped, then moved from `last` by no more than the slew allows, without a gesture; neutral at hover
        throttle, at once, when the setpoint is stale.

    Raises:
        ValueError: a number is NaN or infinite, or `dt` is not positive.
        KeyError: no such layout.
    """
    numbers = (*wanted, *last, age, ttl, dt, throttle_cap or 0.0, hover or 0.0)
    if not all(map(math.isfinite, numbers)) or dt <= 0:
        msg = f"cannot limit {wanted} after {last}: age {age} s, ttl {ttl} s, dt {dt} s"
        raise ValueError(msg)
    room = RANGES[layout]
    low, high = max(cfg.min_throttle, room.lowest), min(cfg.max_throttle, room.highest)
    if not 0.0 <= age <= min(ttl, cfg.setpoint_ttl):
        carries = cfg.hover_throttle if hover is None else hover
        hover = carries if throttle_cap is None else min(carries, throttle_cap)
        return Sticks(0.0, 0.0, 0.0, _clip(hover, low, high))
    step = min(dt, LONGEST_STEP)
    return _without_gesture(
        Sticks(
            pitch=_move(last.pitch, wanted.pitch, cfg.slew * step, min(cfg.max_pitch, room.tilt)),
            roll=_move(last.roll, wanted.roll, cfg.slew * step, min(cfg.max_roll, room.tilt)),
            yaw=_move(last.yaw, wanted.yaw, cfg.slew * step, min(cfg.max_yaw, room.tilt)),
            throttle=_clip(
                last.throttle
                + _clip(wanted.throttle - last.throttle, -cfg.throttle_slew * step, cfg.throttle_slew * step),
                low,
                high,
            ),
        )
    )


def count(sticks: Sticks) -> StickCounts:
    """Round to whole counts; what `limit` bounded stays bounded because every bound is a whole count."""
    return StickCounts(round(sticks.pitch), round(sticks.roll), round(sticks.yaw), round(sticks.throttle))


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _move(last: float, wanted: float, most: float, bound: float) -> float:
    return _clip(last + _clip(wanted - last, -most, most), -bound, bound)


def _without_gesture(sticks: Sticks) -> Sticks:
    """Take yaw out of reach of what the firmware reads as a gesture, whatever the pilot's throttle makes of ours.

    Yaw gives way and not throttle: less yaw is harmless, another throttle is not. Below the low threshold it goes to
    zero, because the receiver's own yaw is added to ours.
    """
    most = 0.0 if sticks.throttle < GESTURE_LOW else GESTURE_YAW
    return Sticks(sticks.pitch, sticks.roll, _clip(sticks.yaw, -most, most), sticks.throttle)

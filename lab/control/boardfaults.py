"""Faults of a flight that the boards report: battery, the pilot's switches, and his throttle below ours."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, Final, get_args

from lab.control.corerig import stamp
from lab.control.faultrig import LOST_SIGHT, Expectation, FaultRig
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.events import StateValue
from mkdaemon.telemetry.state import Battery, Flight, GpsMode, Pilot

REPORT_TIME: Final = 0.2
"""Between two reports of a board [s]."""
HANDS: Final = 0.1
"""A client that flies by hand for a moment may hold no place when the switch is turned [s]."""
VOLTAGE: Final = 14.8
"""Of the battery [V]: the FlightCtrl reports less throttle than its stick."""
LOW_VOLTAGE: Final = 12.8
"""Above which it does [V]."""
FLAGS: Final = [
    name for name, field in Flight.model_fields.items() if bool in (field.annotation, *get_args(field.annotation))
]
NORMAL: Final[dict[str, Any]] = dict.fromkeys(FLAGS, False) | {
    "source": "lab",
    "motors_running": True,
    "is_flying": True,
    "gps_mode": GpsMode.FREE,
    "error_code": 0,
    "error": "none",
    "flying_time": 60.0,
    "waypoint_index": 0,
    "waypoint_count": 0,
    "target_distance": None,
    "altitude_setpoint": None,
}
"""What a board reports of a flight in which nothing is wrong."""


def report(rig: FaultRig, at: float, end: float, tell: Callable[[float], None]) -> None:
    """Let a board report from `at` to `end` [s]."""

    def speak(now: float) -> None:
        tell(now)
        if now + REPORT_TIME < end:
            rig.at(now + REPORT_TIME, speak)

    rig.at(at, speak)


def report_flight(rig: FaultRig, at: float, end: float, **changes: object) -> None:
    """Let a board report something of the flight, and that all is well again when it ends."""

    def tell(now: float, changes: dict[str, object] = changes) -> None:
        rig.core.feed(StateValue(Flight(stamp=stamp(now), **(NORMAL | changes))), now)

    report(rig, at, end, tell)
    rig.at(end, lambda now: tell(now, {}))


def battery_low(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The board's alarm: a sag that ends, or a battery that stays low, which lands or releases after 3 s."""
    pause = rng.choice((rng.uniform(0.3, 2.5), 60.0))

    def tell(now: float) -> None:
        low = now < at + pause
        battery = Battery(
            stamp=stamp(now), source="lab", voltage=9.4 if low else 11.1, current=None, used_mah=None, is_low=low
        )
        rig.core.feed(StateValue(battery), now)

    report(rig, at, at + 60.0, tell)
    return Expectation(("the battery is low",) if pause > 3.0 else ())


def gps_switch(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The pilot turns his GPS switch to hold or coming home under a flight by position."""
    report_flight(rig, at, at + rng.uniform(1.0, 4.0), gps_mode=rng.choice((GpsMode.HOLD, GpsMode.COME_HOME)))
    return Expectation(("the pilot's GPS switch",), HANDS)


def height_control(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The pilot switches height control on."""
    report_flight(rig, at, at + rng.uniform(1.0, 4.0), altitude_control=True)
    return Expectation(("height control is on",), 0.0)


def throttle_capped(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The pilot's throttle is below ours for a while: the aircraft sinks, and he is told; nothing else follows."""
    end = at + rng.uniform(0.2, 0.8)
    rig.trouble.lids.append((at, end, rng.uniform(4.0, 15.0)))
    rig.at(at, rig.lid_moved)
    rig.at(end, rig.lid_moved)

    def tell(now: float) -> None:
        used = (rig.throttle_in_use + GAS_CENTRE) * LOW_VOLTAGE / VOLTAGE - GAS_CENTRE
        pilot = Pilot(
            stamp=stamp(now),
            source="lab",
            rc_quality=1.0,
            has_signal=True,
            throttle=None,
            sticks=None,
            throttle_in_use=used,
            compensated_at=VOLTAGE,
        )
        rig.core.feed(StateValue(pilot), now)

    report(rig, at, at + 4.0, tell)
    return Expectation(LOST_SIGHT)

"""Faults of a flight: client, line, camera, computer, air, and the pilot's throttle below ours.

What can only end a flight, at its time, is asked by `lab.control.triggers`.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, Final

from lab.control.corerig import stamp
from lab.control.faultrig import LOST_SIGHT, NOTHING, Expectation, FaultRig
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.events import SetpointUnsigned, StateValue
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, Setpoint, SetpointFrame, StickSetpoint, VelocitySetpoint
from mkdaemon.telemetry.state import Pilot

REPORT_TIME: Final = 0.2
"""Between two reports of a board [s]."""
VOLTAGE: Final = 14.8
"""Of the battery [V]: the FlightCtrl reports less throttle than its stick."""
LOW_VOLTAGE: Final = 12.8
"""Above which it does [V]."""
Fault = Callable[[FaultRig, float, random.Random], Expectation]
"""Prepares a fault that begins at a time [s]; its numbers are drawn."""
Span = tuple[float, float]
"""Between which a number is drawn."""


def lasts(name: str, *pauses: Span) -> Fault:
    """What is named so in `Trouble` is wrong until a time, one of some pauses after it began [s]."""

    def begin(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
        drawn = [rng.uniform(*pause) for pause in pauses]
        end = at + (rng.choice(drawn) if len(drawn) > 1 else drawn[0])
        rig.at(at, lambda now: setattr(rig.trouble, name, end))
        return Expectation(LOST_SIGHT)

    return begin


def is_off(name: str, pause: Span, off: Span, reasons: tuple[str, ...] = LOST_SIGHT) -> Fault:
    """What is named so in `Trouble` is late or wrong by some amount, for a pause [s]."""

    def begin(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
        spell = (at + rng.uniform(*pause), rng.uniform(*off))
        rig.at(at, lambda now: setattr(rig.trouble, name, spell))
        return Expectation(reasons)

    return begin


def client_silent(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The client stops to stream for a while."""
    pause = rng.choice((rng.uniform(0.05, 0.9), rng.uniform(1.1, 4.0)))
    rig.at(at, lambda now: setattr(rig.trouble, "client_silent", now + pause))
    return Expectation(("no setpoint from",), 1.0) if pause > 1.05 else NOTHING


def stranger(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """Somebody without the secret streams full sticks, of this epoch and others."""
    fake = random.Random(rng.random())

    def speak(now: float) -> None:
        wild = {axis: fake.uniform(-127.0, 127.0) for axis in ("pitch", "roll", "yaw", "throttle")}
        numbers = {"epoch": fake.choice((1, 2, 3)), "sequence": fake.randrange(10**6)}
        setpoint = StickSetpoint.model_validate(wild | numbers | {"ttl": 0.3})
        rig.core.feed(SetpointUnsigned(setpoint), now)
        if now < at + 2.0:
            rig.at(now + 0.01, speak)

    rig.at(at, speak)
    return NOTHING


def other_kinds(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The holder changes to sticks, attitudes or velocities and back, from one setpoint to the next.

    What is flown by the target may be refused from where that leaves the aircraft: it moves too fast.
    """
    end, wild = at + rng.uniform(0.2, 1.0), random.Random(rng.random())

    def wanted(now: float) -> Setpoint | None:
        if now > end:
            rig.stream = None
        stream: dict[str, Any] = {**rig.stream_fields, "ttl": wild.uniform(0.05, 1.0)}
        kind = wild.randrange(3)
        if kind == 0:
            return StickSetpoint(**stream, pitch=wild.uniform(-9, 9), roll=wild.uniform(-9, 9), yaw=0.0, throttle=0.0)
        if kind == 1:
            lean = wild.uniform(-0.1, 0.1)
            return AttitudeSetpoint(**stream, pitch=lean, roll=-lean, yaw_rate=0.0, thrust=1.0)
        speed = (wild.uniform(-20.0, 20.0), wild.uniform(-20.0, 20.0), 0.0)
        return VelocitySetpoint(**stream, velocity=speed, frame=SetpointFrame.BODY)

    rig.at(at, lambda now: setattr(rig, "stream", wanted))
    return Expectation((*LOST_SIGHT, "cannot start from sticks or attitude"))


def eyes_stalled(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The detector stands still for 2 s, then everything it has seen comes at once."""
    rig.at(at, lambda now: setattr(rig.trouble, "eyes_stalled", now + 2.0))
    return Expectation(LOST_SIGHT)


def core_stalled(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The daemon stands still."""
    pause = rng.choice((rng.uniform(0.02, 0.25), rng.uniform(0.35, 1.0)))
    rig.at(at, lambda now: setattr(rig.trouble, "core_stalled", (now, now + pause)))
    return Expectation(("the daemon did not run",), pause) if pause > 0.3 else NOTHING


def gust(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """A gust of up to 5 m/s."""
    speed, course, length = rng.uniform(1.0, 5.0), rng.uniform(0.0, 360.0), rng.uniform(0.5, 3.0)
    rig.at(at, lambda now: rig.disturb("wind_gust", length, speed=speed, from_deg=course))
    return Expectation(LOST_SIGHT)


def compass_off(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The compass is off by up to 25 degrees from one moment to the next."""
    turn = rng.uniform(-25.0, 25.0)
    rig.at(at, lambda now: rig.disturb("compass_bias", 4.0, deg=turn))
    return Expectation(LOST_SIGHT)


def throttle_capped(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The pilot's throttle is below ours for a while: the aircraft sinks, and he is told; nothing else follows."""
    end, reports = at + rng.uniform(0.2, 0.8), at + 4.0
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
        if now + REPORT_TIME < reports:
            rig.at(now + REPORT_TIME, tell)

    rig.at(at, tell)
    return Expectation(LOST_SIGHT)


FAULTS: Final[dict[str, Fault]] = {
    fault.__name__: fault
    for fault in (
        client_silent, stranger, other_kinds, eyes_stalled, core_stalled, gust, compass_off, throttle_capped,
    )
} | {
    "client_wild": lasts("client_wild", (0.2, 1.5)),
    "client_late": is_off("client_late", (0.5, 4.0), (0.02, 0.25), ()),
    "blind": lasts("blind", (0.05, 1.4), (1.4, 2.8), (3.2, 6.0)),
    "camera_late": is_off("camera_late", (0.5, 4.0), (0.05, 0.4)),
    "camera_wrong": is_off("camera_wrong", (0.03, 0.12), (0.2, 1.0)),
    "telemetry_silent": lasts("telemetry_silent", (0.2, 3.0)),
    "uplink_dead": lasts("uplink_dead", (0.1, 0.6)),
}  # fmt: skip
"""Every fault by name."""

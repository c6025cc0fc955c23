"""Faults of a flight: client, line, camera, computer and air; what boards report is in `boardfaults`."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from lab.control.boardfaults import battery_low, gps_switch, height_control, throttle_capped
from lab.control.corerig import stamp
from lab.control.faultrig import LOST_SIGHT, NOTHING, TOLERANCE, Expectation, FaultRig
from mkdaemon.control.events import (
    AbortAsked,
    ClientGone,
    Event,
    GuardActed,
    LineChanged,
    ReleaseAsked,
    SetpointUnsigned,
    StateValue,
)
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import AbortRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, Obstacle
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, Setpoint, SetpointFrame, StickSetpoint, VelocitySetpoint
from mkdaemon.telemetry.state import Pilot

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


def comes(event: Event, reason: str) -> Fault:
    """The core hears of something, and lets go at once."""

    def begin(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
        rig.at(at, lambda now: rig.core.feed(event, 0.0))
        return Expectation((reason,), 0.0)

    return begin


def client_silent(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The client stops to stream for a while."""
    pause = rng.choice((rng.uniform(0.05, 0.9), rng.uniform(1.1, 4.0)))
    rig.at(at, lambda now: setattr(rig.trouble, "client_silent", now + pause))
    return Expectation(("no setpoint from",), 1.0) if pause > 1.05 else NOTHING


def client_dies(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The client's session ends."""

    def die(now: float) -> None:
        rig.trouble.client_silent = math.inf
        rig.core.feed(ClientGone("lab"), 0.0)

    rig.at(at, die)
    return Expectation(("client lab is gone",), 0.0)


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


def taken_over(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """A second client takes the lease by force: the first one's frames end, the aircraft is released."""

    def take(now: float) -> None:
        rig.take("other", now)
        rig.take("other", now, force=True)

    rig.at(at, take)
    return Expectation(("other took the lease",), 0.0)


def aborted(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """Somebody aborts: the place is held; a landing that is committed goes on."""

    def abort(now: float) -> None:
        with suppress(CommandRejectedError):  # nothing is flown any more
            rig.core.feed(AbortAsked(AbortRequest(reason="enough")), 0.0)

    rig.at(at, abort)
    return NOTHING


def eyes_stalled(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The detector stands still for 2 s, then everything it has seen comes at once."""
    rig.at(at, lambda now: setattr(rig.trouble, "eyes_stalled", now + 2.0))
    return Expectation(LOST_SIGHT)


def core_stalled(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The daemon stands still."""
    pause = rng.choice((rng.uniform(0.02, 0.25), rng.uniform(0.35, 1.0)))
    rig.at(at, lambda now: setattr(rig.trouble, "core_stalled", (now, now + pause)))
    return Expectation(("the daemon did not run",), pause) if pause > 0.3 else NOTHING


def line_bad(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The line is mute, garbage, one-way or degraded for a while."""
    condition = rng.choice((LinkCondition.MUTE, LinkCondition.GARBAGE, LinkCondition.ONE_WAY, LinkCondition.DEGRADED))
    patience = {LinkCondition.ONE_WAY: 1.0, LinkCondition.DEGRADED: math.inf}.get(condition, 0.65)
    pause = rng.choice((rng.uniform(0.02, 0.1), rng.uniform(0.3, 3.0)))
    rig.at(at, lambda now: rig.set_link(condition, now))
    rig.at(at + pause, lambda now: rig.set_link(LinkCondition.UP, now))
    is_certain = pause > patience * TOLERANCE + 0.1
    return Expectation((f"the link is {condition.value}",), patience if is_certain else math.inf)


def line_gone(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The port is lost and opened again."""
    rig.at(at, lambda now: rig.set_link(LinkCondition.DOWN, now))
    rig.at(at + 0.5, lambda now: rig.set_link(LinkCondition.UP, now, openings=2))
    return Expectation(("the link is down",), 0.0)


def line_refuses(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The line takes no stick frames, for one of its reasons."""
    line, reason = rng.choice(
        (
            (ControlLine(reason="the boards are being asked again"), "external control is not possible"),
            (ControlLine(layout="v2", obstacle=Obstacle.RELEASING), "a release is under way"),
            (ControlLine(layout="v2", obstacle=Obstacle.UNCONFIRMED), "the last release is not confirmed"),
        )
    )
    rig.at(at, lambda now: rig.core.feed(LineChanged(line), 0.0))
    rig.at(at + 1.0, lambda now: rig.core.feed(LineChanged(ControlLine(layout="v2")), 0.0))
    return Expectation((reason,), 0.0)


def receiver_lost(rig: FaultRig, at: float, rng: random.Random) -> Expectation:
    """The FlightCtrl loses the pilot's transmitter."""
    lost = Pilot(stamp=stamp(at), source="lab", rc_quality=0.0, has_signal=False, throttle=None, sticks=None)
    rig.at(at, lambda now: rig.core.feed(StateValue(lost), now))
    return Expectation(("the receiver is lost",), 0.0)


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


FAULTS: Final[dict[str, Fault]] = {
    fault.__name__: fault
    for fault in (
        client_silent, client_dies, stranger, other_kinds, taken_over, aborted, eyes_stalled, core_stalled,
        line_bad, line_gone, line_refuses, receiver_lost, gust, compass_off, battery_low, gps_switch, height_control,
        throttle_capped,
    )
} | {
    "client_wild": lasts("client_wild", (0.2, 1.5)),
    "client_late": is_off("client_late", (0.5, 4.0), (0.02, 0.25), ()),
    "release_asked": comes(ReleaseAsked(ReleaseRequest(reason="somebody asks")), "somebody asks"),
    "blind": lasts("blind", (0.05, 1.4), (1.4, 2.8), (3.2, 6.0)),
    "camera_late": is_off("camera_late", (0.5, 4.0), (0.05, 0.4)),
    "camera_wrong": is_off("camera_wrong", (0.03, 0.12), (0.2, 1.0)),
    "guard_acts": comes(GuardActed(), "the guard released"),
    "telemetry_silent": lasts("telemetry_silent", (0.2, 3.0)),
    "uplink_dead": lasts("uplink_dead", (0.1, 0.6)),
}  # fmt: skip
"""Every fault by name."""

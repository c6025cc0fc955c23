"""The checks before a flight: one table, shown by `mkctl preflight`; it refuses the lease and autonomous flight.

To add a check, add its row, and its refusal to `telemetry/refusals.py`. Source of the rules: docs/flying.md, "Before
the first flight"; docs/safety.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from mkdaemon.control.activeset import OPEN_ABOVE, GateKind
from mkdaemon.control.batterywatch import low_voltage
from mkdaemon.control.estimator.model import Gap
from mkdaemon.control.knowledge import Knowledge
from mkdaemon.control.motionmatch import ALIKE
from mkdaemon.control.verdict import Verdict, passed, stands, unknown
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import GpsMode
from mkdaemon.telemetry.vision import Alarm, EyeState, VisionStats

LEAST_QUALITY: Final = 0.75
"""Receiver quality with which a flight may begin; below 0.5 the FlightCtrl flies on emergency throttle."""
MOST_LOSS: Final = 20.0
"""Lost echoes with which a flight may begin [%]; hovers bore bursty loss of 25 %, docs/control.md."""
STAMP_LIMIT: Final = 0.045
"""Largest error of the images' stamps, as it is measured [s]: 20 ms are survived, 80 ms crash, and the measurement is
off by up to 20 ms; docs/control.md, "Time stamps"."""
HIGHEST_EMERGENCY: Final = 0.95
"""An emergency throttle above this does not sink [share of the hover throttle]."""
LOWEST_EMERGENCY: Final = 0.7
"""With one below this the aircraft falls: half of its weight is carried [share of the hover throttle]."""
LEAST_DISK: Final = 200e6
"""Free space with which a flight may begin [bytes]: an hour of the recorder's small streams."""
EYES_FRESH: Final = 3.0
"""What a camera said of itself longer ago counts no more [s]; it says so once a second."""
LATEST_IMAGES: Final = 500.0
"""Median age of images that have been looked at, with which a flight may begin [ms]: take-offs were flown by images
0.6 s old; of 0.9 s, which the estimator's history no longer holds, they climbed to 12 m."""
_UNFIT: Final = (Alarm.UNCALIBRATED, Alarm.WRONG_SIZE, Alarm.TARGET_MISMATCH)


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table.

    Attributes:
        name: shown.
        blocks: what is prevented while it stands.
        look: the check itself.
    """

    name: str
    blocks: Blocks
    look: Callable[[Knowledge], Verdict]


def _guard(known: Knowledge) -> Verdict:
    return passed("it runs") if known.has_guard else stands(refuse(Token.GUARD_DEAD))


def _firmware(known: Knowledge) -> Verdict:
    line = known.line
    if line.layout is None:
        return stands(refuse(Token.NO_CONTROL, detail=line.reason or "this firmware has no external control"))
    words = "" if known.link is None else known.link.firmware
    return passed(f"{words or 'known'}; external control {line.layout}")


def _link(known: Knowledge) -> Verdict:
    link = known.link
    if link is None or not link.condition.is_usable:
        condition = LinkCondition.ABSENT if link is None else link.condition
        return stands(refuse(Token.LINK_DOWN, state=condition.value, detail="" if link is None else link.reason))
    return passed(f"{link.condition.value}: {link.reason}")


def _losses(known: Knowledge) -> Verdict:
    echo = None if known.health is None else known.health.echo
    if echo is None or not echo.sent:
        return unknown("no echo has been asked for yet")
    if echo.loss_percent > MOST_LOSS:
        return stands(refuse(Token.LINK_POOR, lost=echo.loss_percent, limit=MOST_LOSS))
    return passed(f"{echo.loss_percent:.0f} % of {echo.sent} echoes lost")


def _gate(known: Knowledge) -> Verdict:
    gate = known.active_set.gate
    if gate.kind is GateKind.UNKNOWN:
        return unknown("it cannot be read from here: look with `mkctl settings show`")
    if gate.kind is GateKind.CHANNEL:
        return passed(f"a switch of the transmitter: ExternalControl {gate.value}")
    if gate.value <= OPEN_ABOVE:
        return stands(refuse(Token.GATE_SHUT, value=gate.value))
    if not known.lease.allow_constant_gate:
        return stands(refuse(Token.GATE_CONSTANT, value=gate.value))
    return passed(f"the constant {gate.value}, which the operator has accepted")


def _gate_alone(known: Knowledge) -> Verdict:
    channel = known.active_set.gate.altitude_channel
    if channel is not None:
        return stands(refuse(Token.GATE_SWITCHES_ALTITUDE, channel=channel))
    return passed("it switches nothing else") if known.active_set.is_known else unknown("it cannot be read from here")


def _height_control(known: Knowledge) -> Verdict:
    flight = known.flight
    if flight is not None and flight.altitude_control:
        return stands(refuse(Token.HEIGHT_CONTROL, detail="the FlightCtrl says that it is on"))
    if known.active_set.has_height_control:
        return stands(refuse(Token.HEIGHT_CONTROL, detail="bit 0 of GlobalConfig of the active set allows it"))
    return passed("off (GlobalConfig bit 0)") if known.active_set.is_known else unknown("it cannot be read from here")


def _gps_switch(known: Knowledge) -> Verdict:
    flight = known.flight
    if flight is None or flight.gps_mode is GpsMode.UNKNOWN:
        return unknown("no NaviCtrl says where it stands")
    if flight.gps_mode.steers:
        return stands(refuse(Token.GPS_STEERS, mode=flight.gps_mode.value))
    return passed("at free: the NaviCtrl does not steer")


def _emergency(known: Knowledge) -> Verdict:
    throttle, hover = known.active_set.emergency_throttle, known.hover_gas
    if not known.active_set.is_known or throttle is None:
        return unknown("it cannot be read from here, or is a share of what the board has learnt")
    if throttle > HIGHEST_EMERGENCY * hover:
        return stands(refuse(Token.EMERGENCY_CLIMBS, value=throttle, hover=round(hover)))
    return passed(f"NotGas {throttle} is below hover, about {hover:.0f}")


def _emergency_gentle(known: Knowledge) -> Verdict:
    found, hover = known.active_set, known.hover_gas
    if not found.is_known or found.emergency_throttle is None:
        return unknown("it cannot be read from here")
    if found.emergency_throttle < LOWEST_EMERGENCY * hover or not found.emergency_time:
        refusal = refuse(
            Token.EMERGENCY_FALLS,
            value=found.emergency_throttle,
            time=found.emergency_time,
            share=100.0 * (found.emergency_throttle / hover) ** 2,
            low=math.ceil(0.85 * hover),
            high=math.floor(HIGHEST_EMERGENCY * hover),
        )
        return stands(refusal)
    return passed(f"{100.0 * (found.emergency_throttle / hover) ** 2:.0f} % of the weight are carried")


def _receiver(known: Knowledge) -> Verdict:
    if known.flight is not None and known.flight.emergency_landing:
        return stands(refuse(Token.RECEIVER_WEAK, quality=0.0, limit=100.0 * LEAST_QUALITY))
    if known.pilot is None:
        return unknown("nobody says how good the reception is")
    if known.pilot.rc_quality < LEAST_QUALITY:
        return stands(refuse(Token.RECEIVER_WEAK, quality=100.0 * known.pilot.rc_quality, limit=100.0 * LEAST_QUALITY))
    return passed(f"{100.0 * known.pilot.rc_quality:.0f} %")


def _battery(known: Knowledge) -> Verdict:
    battery, flight = known.battery, known.flight
    if battery is None:
        return unknown("nobody says how full it is")
    low = battery.is_low or (flight is not None and flight.battery_low)
    if low or battery.voltage < low_voltage(known.active_set, known.highest_voltage):
        return stands(refuse(Token.BATTERY_LOW, voltage=battery.voltage))
    return passed(f"{battery.voltage:.1f} V")


def _camera(known: Knowledge) -> Verdict:
    eyes = [stats for stats in known.eyes if known.now - stats.stamp.monotonic <= EYES_FRESH]
    if not eyes:
        return unknown("no camera of this daemon; poses may come from elsewhere")
    unfit = [f"{stats.camera}: {why}" for stats in eyes if (why := _unfit(stats))]
    if len(unfit) == len(eyes):
        return stands(refuse(Token.CAMERA_UNFIT, detail="; ".join(unfit)))
    return passed(f"{len(eyes) - len(unfit)} of {len(eyes)} see, calibrated")


def _agreement(known: Knowledge) -> Verdict:
    if known.contradicting:
        return stands(refuse(Token.CAMERAS_CONTRADICT, cameras=", ".join(known.contradicting)))
    return passed("no camera contradicts another")


def _unfit(stats: VisionStats) -> str:
    """Why a camera cannot be flown by; empty where it can."""
    for alarm in _UNFIT:
        if alarm in stats.alarms:
            return stats.alarms[alarm]
    return "" if stats.state is EyeState.OK else f"{stats.state.value}: {stats.reason}"


def _lateness(known: Knowledge) -> Verdict:
    eyes = [stats for stats in known.eyes if known.now - stats.stamp.monotonic <= EYES_FRESH and stats.processed]
    if not eyes:
        return unknown("no camera of this daemon; poses may come from elsewhere")
    best = min(eyes, key=lambda stats: stats.latency_p50_ms)
    if best.latency_p50_ms > LATEST_IMAGES:
        return stands(refuse(Token.IMAGES_LATE, camera=best.camera, late=best.latency_p50_ms, limit=LATEST_IMAGES))
    return passed(f"half of them are looked at within {best.latency_p50_ms:.0f} ms of their exposure")


def _target(known: Knowledge) -> Verdict:
    age = known.target_age
    if age is None:
        return unknown("none was seen; from the ground that says nothing, in the air autonomous flight waits for it")
    return passed("in sight") if age <= 1.0 else unknown(f"the last image of it is {age:.0f} s old")


def _stamps(known: Knowledge) -> Verdict:
    match = known.stamps
    if match is None:
        return unknown("nothing moved enough in sight of the target: turn it by hand over the target, some degrees")
    if match.likeness <= -ALIKE:
        return stands(refuse(Token.CAMERA_TURNED, likeness=match.likeness))
    if match.likeness < ALIKE:
        return unknown(f"camera and boards tell of different motion (correlation {match.likeness:.1f}): move faster")
    if abs(match.lag) > STAMP_LIMIT:
        return stands(refuse(Token.STAMPS_OFF, lag=1000.0 * match.lag, limit=1000.0 * STAMP_LIMIT))
    return passed(f"camera and boards move together to {1000.0 * match.lag:+.0f} ms")


def _model(known: Knowledge) -> Verdict:
    model = known.model
    if model is None:
        return passed("known from the active parameter set")
    match model.gap:
        case Gap.ON_POTENTIOMETER:
            return stands(refuse(Token.GAIN_ON_POTI, parameter=model.parameter, value=model.value, poti=model.poti))
        case Gap.NO_AIRCRAFT:
            return stands(refuse(Token.GAIN_ZERO, parameter=model.parameter, value=model.value))
        case Gap.UNREAD:
            return unknown("its set cannot be read from here: it is flown as one with the set Easy")


def _loop(known: Knowledge) -> Verdict:
    if known.loop is not None:
        return stands(known.loop)
    if not known.is_loop_known:
        return unknown("it is not computed in flight")
    return passed("stable on the model of this aircraft, with the configured limits")


def _disk(known: Knowledge) -> Verdict:
    if known.free_disk is None:
        return unknown("nobody looked")
    if known.free_disk < LEAST_DISK:
        return stands(refuse(Token.DISK_FULL, free=known.free_disk / 1e6, limit=LEAST_DISK / 1e6))
    return passed(f"{known.free_disk / 1e9:.1f} GB free")


CHECKS: Final = (
    Check("guard", Blocks.LEASE, _guard),
    Check("firmware and layout", Blocks.LEASE, _firmware),
    Check("link", Blocks.LEASE, _link),
    Check("gate", Blocks.LEASE, _gate),
    Check("gate and height control", Blocks.LEASE, _gate_alone),
    Check("link losses", Blocks.AUTONOMY, _losses),
    Check("height control", Blocks.AUTONOMY, _height_control),
    Check("GPS switch", Blocks.AUTONOMY, _gps_switch),
    Check("emergency throttle", Blocks.AUTONOMY, _emergency),
    Check("emergency descent", Blocks.NOTHING, _emergency_gentle),
    Check("aircraft model", Blocks.AUTONOMY, _model),
    Check("control loop", Blocks.AUTONOMY, _loop),
    Check("receiver", Blocks.AUTONOMY, _receiver),
    Check("battery", Blocks.AUTONOMY, _battery),
    Check("camera", Blocks.AUTONOMY, _camera),
    Check("agreement of cameras", Blocks.AUTONOMY, _agreement),
    Check("age of images", Blocks.AUTONOMY, _lateness),
    Check("target", Blocks.AUTONOMY, _target),
    Check("time stamps", Blocks.AUTONOMY, _stamps),
    Check("disk", Blocks.AUTONOMY, _disk),
)
"""Every check, in the order in which the first one that stands is named."""


def findings(known: Knowledge) -> tuple[Finding, ...]:
    """What every check finds, as it is shown."""
    return tuple(_shown(check, check.look(known)) for check in CHECKS)


def is_ready(found: tuple[Finding, ...]) -> bool:
    """Whether nothing prevents a flight against a target."""
    return all(each.state is not CheckState.STANDS or each.blocks is Blocks.NOTHING for each in found)


def standing(known: Knowledge, blocks: Blocks) -> Iterator[CommandRejectedError]:
    """The refusals of all that prevents something."""
    for check in CHECKS:
        if check.blocks is blocks and (refusal := check.look(known).refusal) is not None:
            yield refusal


def _shown(check: Check, verdict: Verdict) -> Finding:
    refusal = verdict.refusal
    return Finding(
        name=check.name,
        state=verdict.state,
        blocks=check.blocks,
        token=None if refusal is None else refusal.token,
        reason=verdict.words,
        fix="" if refusal is None else refusal.fix,
    )

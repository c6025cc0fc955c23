"""Rows about the lease and about flying: what `mkctl preflight` shows, and what a manoeuvre needs.

Source of the rules: docs/flying.md, "Before the first flight"; docs/safety.md.
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.control.activeset import OPEN_ABOVE, GateKind
from mkdaemon.control.admission.beginnings import BY_TARGET, Concern, TakeLease
from mkdaemon.control.admission.manoeuvrelooks import BEGIN_ROWS, NEED_ROWS
from mkdaemon.control.admission.row import Rows, Rule, Verdict, passed, stands, unknown, when
from mkdaemon.control.admission.sightlooks import SIGHT_ROWS
from mkdaemon.control.admission.situation import Situation
from mkdaemon.control.estimator.model import Gap
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.preflight import LEAST_DISK
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import GpsMode

LEAST_QUALITY: Final = 0.75
"""Receiver quality with which a flight may begin; below 0.5 the FlightCtrl flies on emergency throttle."""
MOST_LOSS: Final = 44.0
"""Link tests not answered in time with which a flight may begin [%]. A radio that loses 15 % each way, over which
demonstrations finish, has 28 % of them unanswered; over the 50 of the window, on the ground, 44 % at most in 19 of 20
moments. One that loses 25 % each way is refused in 2 of 5 moments: hovers bear it, and stray by more than a metre."""
HIGHEST_EMERGENCY: Final = 0.95
"""An emergency throttle above this does not sink [share of the hover throttle]."""
LOWEST_EMERGENCY: Final = 0.7
"""With one below this the aircraft falls: half of its weight is carried [share of the hover throttle]."""

_LEASE: Final = (Concern.LEASE,)
_NOT_LANDING: Final = tuple(kind for kind in BY_TARGET if kind is not Concern.LAND)

LEASE_ROWS: Final = Rows()
"""What prevents the lease; what keeps the boards busy does, too: see `boardrows`."""
CHECK_ROWS: Final = Rows()
"""What prevents a manoeuvre by the target: the aircraft, its settings, this computer."""


@LEASE_ROWS.row(
    "way to the client",
    _LEASE,
    "the way to the client and back takes longer than `control.lease.max_path_delay`, or is not known",
    Token.SLOW_PATH,
    is_early=True,
)
def _path(now: Situation, wanted: TakeLease) -> Verdict:
    """Every time of the ladder counts from a setpoint's arrival; who sent it sees all of them later by this delay."""
    delay, limit = wanted.path_delay, now.cfg.lease.max_path_delay
    if delay is None or delay <= limit:
        return passed()
    took = f"takes {delay:.2f} s" if math.isfinite(delay) else "is unknown"
    return stands(refuse(Token.SLOW_PATH, took=took, limit=limit))


@LEASE_ROWS.check("guard", _LEASE, "the guard process is gone", Token.GUARD_DEAD)
def _guard(now: Situation) -> Verdict:
    return passed("it runs") if now.has_guard else stands(refuse(Token.GUARD_DEAD))


@LEASE_ROWS.check(
    "firmware and layout", _LEASE, "the firmware is unknown, or has no external control", Token.NO_CONTROL
)
def _firmware(now: Situation) -> Verdict:
    line = now.line
    if line.layout is None:
        return stands(refuse(Token.NO_CONTROL, detail=line.reason or "this firmware has no external control"))
    words = "" if now.link is None else now.link.firmware
    return passed(f"{words or 'known'}; external control {line.layout}")


@LEASE_ROWS.check("link", _LEASE, "the link is not up or degraded", Token.LINK_DOWN)
def _link(now: Situation) -> Verdict:
    link = now.link
    if link is None or not link.condition.is_usable:
        condition = LinkCondition.ABSENT if link is None else link.condition
        return stands(refuse(Token.LINK_DOWN, state=condition.value, detail="" if link is None else link.reason))
    return passed(f"{link.condition.value}: {link.reason}")


@CHECK_ROWS.check(
    "link losses",
    _NOT_LANDING,
    f"more than {MOST_LOSS:g} % of the link tests are not answered in time",
    Token.LINK_POOR,
    is_asked_again=False,
)
def _losses(now: Situation) -> Verdict:
    echo = None if now.health is None else now.health.echo
    if echo is None or not echo.sent:
        return unknown("no link test has been sent yet")
    if echo.loss_percent > MOST_LOSS:
        return stands(refuse(Token.LINK_POOR, lost=echo.loss_percent, limit=MOST_LOSS))
    return passed(f"{echo.lost} of {echo.sent} link tests not answered in time")


@LEASE_ROWS.check(
    "gate",
    _LEASE,
    "ExternalControl of the active set is 128 or less, or a constant that `control.lease.allow_constant_gate` does "
    "not accept",
    Token.GATE_SHUT,
    Token.GATE_CONSTANT,
)
def _gate(now: Situation) -> Verdict:
    gate = now.active_set.gate
    if gate.kind is GateKind.UNKNOWN:
        return unknown("it cannot be read from here: look with `mkctl settings show`")
    if gate.kind is GateKind.CHANNEL:
        return passed(f"a switch of the transmitter: ExternalControl {gate.value}")
    if gate.value <= OPEN_ABOVE:
        return stands(refuse(Token.GATE_SHUT, value=gate.value))
    if not now.cfg.lease.allow_constant_gate:
        return stands(refuse(Token.GATE_CONSTANT, value=gate.value))
    return passed(f"the constant {gate.value}, which the operator has accepted")


@LEASE_ROWS.check(
    "gate and height control",
    _LEASE,
    "the switch of the gate also turns height control on",
    Token.GATE_SWITCHES_ALTITUDE,
)
def _gate_alone(now: Situation) -> Verdict:
    channel = now.active_set.gate.altitude_channel
    if channel is not None:
        return stands(refuse(Token.GATE_SWITCHES_ALTITUDE, channel=channel))
    return passed("it switches nothing else") if now.active_set.is_known else unknown("it cannot be read from here")


@CHECK_ROWS.check(
    "height control", BY_TARGET, "height control is on, or the active set allows it", Token.HEIGHT_CONTROL
)
def _height_control(now: Situation) -> Verdict:
    flight = now.flight
    if flight is not None and flight.altitude_control:
        return stands(refuse(Token.HEIGHT_CONTROL, detail="the FlightCtrl says that it is on"))
    if now.active_set.has_height_control:
        return stands(refuse(Token.HEIGHT_CONTROL, detail="bit 0 of GlobalConfig of the active set allows it"))
    return passed("off (GlobalConfig bit 0)") if now.active_set.is_known else unknown("it cannot be read from here")


@CHECK_ROWS.check("GPS switch", BY_TARGET, "the pilot's GPS switch is not at free", Token.GPS_STEERS)
def _gps_switch(now: Situation) -> Verdict:
    flight = now.flight
    if flight is None or flight.gps_mode is GpsMode.UNKNOWN:
        return unknown("no NaviCtrl says where it stands")
    if flight.gps_mode.steers:
        return stands(refuse(Token.GPS_STEERS, mode=flight.gps_mode.value))
    return passed("at free: the NaviCtrl does not steer")


@CHECK_ROWS.check(
    "emergency throttle",
    _NOT_LANDING,
    f"NotGas is more than {100 * HIGHEST_EMERGENCY:g} % of the hover throttle",
    Token.EMERGENCY_CLIMBS,
)
def _emergency(now: Situation) -> Verdict:
    throttle, hover = now.active_set.emergency_throttle, now.hover_gas
    if not now.active_set.is_known or throttle is None:
        return unknown("it cannot be read from here, or is a share of what the board has learnt")
    if throttle > HIGHEST_EMERGENCY * hover:
        return stands(refuse(Token.EMERGENCY_CLIMBS, value=throttle, hover=round(hover)))
    return passed(f"NotGas {throttle} is below hover, about {hover:.0f}")


@CHECK_ROWS.check(
    "emergency descent",
    _NOT_LANDING,
    f"NotGas is less than {100 * LOWEST_EMERGENCY:g} % of the hover throttle, or NotGasZeit is 0",
    Token.EMERGENCY_FALLS,
    rule=Rule.ADVICE,
)
def _emergency_gentle(now: Situation) -> Verdict:
    found, hover = now.active_set, now.hover_gas
    if not found.is_known or found.emergency_throttle is None:
        return unknown("it cannot be read from here")
    share = 100.0 * (found.emergency_throttle / hover) ** 2
    if found.emergency_throttle < LOWEST_EMERGENCY * hover or not found.emergency_time:
        refusal = refuse(
            Token.EMERGENCY_FALLS,
            value=found.emergency_throttle,
            time=found.emergency_time,
            share=share,
            low=math.ceil(0.85 * hover),
            high=math.floor(HIGHEST_EMERGENCY * hover),
        )
        return stands(refusal)
    return passed(f"{share:.0f} % of the weight are carried")


@CHECK_ROWS.check(
    "aircraft model",
    BY_TARGET,
    "a gain of the active set is on a potentiometer, or zero",
    Token.GAIN_ON_POTI,
    Token.GAIN_ZERO,
)
def _model(now: Situation) -> Verdict:
    model = now.model
    if model is None:
        return passed("known from the active parameter set")
    match model.gap:
        case Gap.ON_POTENTIOMETER:
            return stands(refuse(Token.GAIN_ON_POTI, parameter=model.parameter, value=model.value, poti=model.poti))
        case Gap.NO_AIRCRAFT:
            return stands(refuse(Token.GAIN_ZERO, parameter=model.parameter, value=model.value))
        case Gap.UNREAD:
            return unknown("its set cannot be read from here: it is flown as one with set 3 as the factory ships it")


@CHECK_ROWS.check(
    "control loop",
    BY_TARGET,
    "the loop with the configured limits is not safe on the model of this aircraft",
    Token.LOOP_UNSTABLE,
)
def _loop(now: Situation) -> Verdict:
    if now.loop is not None:
        # A new error each time: raising a kept one would add its traceback to it.
        return stands(CommandRejectedError(now.loop.token, now.loop.reason, now.loop.fix))
    return passed("stable on the model of this aircraft, with the configured limits")


@CHECK_ROWS.check(
    "receiver",
    _NOT_LANDING,
    f"the receiver quality is below {100 * LEAST_QUALITY:g} %, or the FlightCtrl lands by itself",
    Token.RECEIVER_WEAK,
)
def _receiver(now: Situation) -> Verdict:
    limit = 100.0 * LEAST_QUALITY
    if now.flight is not None and now.flight.emergency_landing:
        return stands(refuse(Token.RECEIVER_WEAK, quality=0.0, limit=limit))
    if now.pilot is None:
        return unknown("no board reports the reception")
    if now.pilot.rc_quality < LEAST_QUALITY:
        return stands(refuse(Token.RECEIVER_WEAK, quality=100.0 * now.pilot.rc_quality, limit=limit))
    return passed(f"{100.0 * now.pilot.rc_quality:.0f} %")


@CHECK_ROWS.check(
    "battery",
    _NOT_LANDING,
    "the board reports it, or a cell is below the voltage of the active set",
    Token.BATTERY_LOW,
)
def _battery(now: Situation) -> Verdict:
    battery, flight = now.battery, now.flight
    if battery is None:
        return unknown("no board reports the battery")
    low = battery.is_low or (flight is not None and flight.battery_low)
    if low or battery.voltage < now.active_set.low_voltage(now.cells):
        return stands(refuse(Token.BATTERY_LOW, voltage=battery.voltage))
    return passed(f"{battery.voltage:.1f} V")


@CHECK_ROWS.check(
    "battery cells",
    _NOT_LANDING,
    "the battery may have one cell more than its voltage shows, and `battery_cells` is not set",
    Token.CELLS_DOUBTFUL,
    rule=Rule.ADVICE,
)
def _cells(now: Situation) -> Verdict:
    if now.battery is None or now.cells is None:
        return unknown("no battery voltage is reported")
    if now.are_cells_doubtful:
        voltage, more = now.battery.voltage, now.cells + 1
        refusal = refuse(Token.CELLS_DOUBTFUL, voltage=voltage, cells=now.cells, more=more, cell=voltage / more)
        return stands(refusal)
    return passed(f"{now.cells} cells")


@CHECK_ROWS.check(
    "disk", _NOT_LANDING, f"less than {LEAST_DISK / 1e6:g} MB are free where flights are recorded", Token.DISK_FULL
)
def _disk(now: Situation) -> Verdict:
    if now.free_disk is None:
        return unknown("not measured yet")
    if now.free_disk < LEAST_DISK:
        return stands(refuse(Token.DISK_FULL, free=now.free_disk / 1e6, limit=LEAST_DISK / 1e6))
    return passed(f"{now.free_disk / 1e9:.1f} GB free")


@LEASE_ROWS.row("holder", _LEASE, "another client holds the lease, and the request lacks `force`", Token.LEASE_HELD)
def _holder(now: Situation, wanted: TakeLease) -> Verdict:
    if not now.holder or now.lease_left <= 0 or wanted.force:
        return passed()
    return stands(refuse(Token.LEASE_HELD, holder=now.holder, left=now.lease_left))


@LEASE_ROWS.row("release under way", _LEASE, "a release is under way and no client holds the lease", Token.BUSY)
def _released(now: Situation, wanted: object) -> Verdict:
    is_releasing = not now.holder and now.phase is Phase.RELEASING
    return when(refuse(Token.BUSY, detail="a release is under way") if is_releasing else None)


FLIGHT_ROWS: Final = (*NEED_ROWS, *CHECK_ROWS, *SIGHT_ROWS, *BEGIN_ROWS)
"""What prevents a manoeuvre, in the order in which the first one is named."""

"""Rows about the lease and about flying: what `mkctl preflight` shows, and what a manoeuvre needs.

Source of the rules: docs/flying.md, "Before the first flight"; docs/safety.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from mkdaemon.control.activeset import OPEN_ABOVE, GateKind
from mkdaemon.control.admission.beginnings import BY_TARGET, MANOEUVRES, Concern, TakeLease
from mkdaemon.control.admission.manoeuvrelooks import (
    CARRIES,
    STANDS,
    answer,
    board_listens,
    certain,
    clean,
    estimate,
    feet_down,
    flown_target,
    frame,
    fresh_image,
    in_air,
    motors_run,
    named_target,
    near,
    off_ground,
    on_ground,
    one_target,
    slow,
    throttle_low,
)
from mkdaemon.control.admission.row import Look, Row, Rule, Verdict, at, passed, stands, unknown, when
from mkdaemon.control.admission.sightlooks import (
    LATEST_IMAGES,
    STAMP_LIMIT,
    agreement,
    camera,
    heights,
    lateness,
    stamps,
    target,
)
from mkdaemon.control.admission.situation import ASIDE, Situation
from mkdaemon.control.batterywatch import low_voltage
from mkdaemon.control.estimator.model import Gap
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
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
LEAST_DISK: Final = 200e6
"""Free space with which a flight may begin [bytes]: an hour of the recorder's small streams."""


def _guard(now: Situation) -> Verdict:
    return passed("it runs") if now.has_guard else stands(refuse(Token.GUARD_DEAD))


def _firmware(now: Situation) -> Verdict:
    line = now.line
    if line.layout is None:
        return stands(refuse(Token.NO_CONTROL, detail=line.reason or "this firmware has no external control"))
    words = "" if now.link is None else now.link.firmware
    return passed(f"{words or 'known'}; external control {line.layout}")


def _link(now: Situation) -> Verdict:
    link = now.link
    if link is None or not link.condition.is_usable:
        condition = LinkCondition.ABSENT if link is None else link.condition
        return stands(refuse(Token.LINK_DOWN, state=condition.value, detail="" if link is None else link.reason))
    return passed(f"{link.condition.value}: {link.reason}")


def _losses(now: Situation) -> Verdict:
    echo = None if now.health is None else now.health.echo
    if echo is None or not echo.sent:
        return unknown("no link test has been sent yet")
    if echo.loss_percent > MOST_LOSS:
        return stands(refuse(Token.LINK_POOR, lost=echo.loss_percent, limit=MOST_LOSS))
    return passed(f"{echo.lost} of {echo.sent} link tests not answered in time")


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


def _gate_alone(now: Situation) -> Verdict:
    channel = now.active_set.gate.altitude_channel
    if channel is not None:
        return stands(refuse(Token.GATE_SWITCHES_ALTITUDE, channel=channel))
    return passed("it switches nothing else") if now.active_set.is_known else unknown("it cannot be read from here")


def _height_control(now: Situation) -> Verdict:
    flight = now.flight
    if flight is not None and flight.altitude_control:
        return stands(refuse(Token.HEIGHT_CONTROL, detail="the FlightCtrl says that it is on"))
    if now.active_set.has_height_control:
        return stands(refuse(Token.HEIGHT_CONTROL, detail="bit 0 of GlobalConfig of the active set allows it"))
    return passed("off (GlobalConfig bit 0)") if now.active_set.is_known else unknown("it cannot be read from here")


def _gps_switch(now: Situation) -> Verdict:
    flight = now.flight
    if flight is None or flight.gps_mode is GpsMode.UNKNOWN:
        return unknown("no NaviCtrl says where it stands")
    if flight.gps_mode.steers:
        return stands(refuse(Token.GPS_STEERS, mode=flight.gps_mode.value))
    return passed("at free: the NaviCtrl does not steer")


def _emergency(now: Situation) -> Verdict:
    throttle, hover = now.active_set.emergency_throttle, now.hover_gas
    if not now.active_set.is_known or throttle is None:
        return unknown("it cannot be read from here, or is a share of what the board has learnt")
    if throttle > HIGHEST_EMERGENCY * hover:
        return stands(refuse(Token.EMERGENCY_CLIMBS, value=throttle, hover=round(hover)))
    return passed(f"NotGas {throttle} is below hover, about {hover:.0f}")


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


def _loop(now: Situation) -> Verdict:
    if now.loop is not None:
        # A new one: whoever raises it would hang the way it went to one that is kept.
        return stands(CommandRejectedError(now.loop.token, now.loop.reason, now.loop.fix))
    return passed("stable on the model of this aircraft, with the configured limits")


def _receiver(now: Situation) -> Verdict:
    limit = 100.0 * LEAST_QUALITY
    if now.flight is not None and now.flight.emergency_landing:
        return stands(refuse(Token.RECEIVER_WEAK, quality=0.0, limit=limit))
    if now.pilot is None:
        return unknown("nobody says how good the reception is")
    if now.pilot.rc_quality < LEAST_QUALITY:
        return stands(refuse(Token.RECEIVER_WEAK, quality=100.0 * now.pilot.rc_quality, limit=limit))
    return passed(f"{100.0 * now.pilot.rc_quality:.0f} %")


def _battery(now: Situation) -> Verdict:
    battery, flight = now.battery, now.flight
    if battery is None:
        return unknown("nobody says how full it is")
    low = battery.is_low or (flight is not None and flight.battery_low)
    if low or battery.voltage < low_voltage(now.active_set, now.cells):
        return stands(refuse(Token.BATTERY_LOW, voltage=battery.voltage))
    return passed(f"{battery.voltage:.1f} V")


def _cells(now: Situation) -> Verdict:
    if now.battery is None or now.cells is None:
        return unknown("no battery voltage is reported")
    if now.are_cells_doubtful:
        voltage, more = now.battery.voltage, now.cells + 1
        refusal = refuse(Token.CELLS_DOUBTFUL, voltage=voltage, cells=now.cells, more=more, cell=voltage / more)
        return stands(refusal)
    return passed(f"{now.cells} cells")


def _disk(now: Situation) -> Verdict:
    if now.free_disk is None:
        return unknown("nobody looked")
    if now.free_disk < LEAST_DISK:
        return stands(refuse(Token.DISK_FULL, free=now.free_disk / 1e6, limit=LEAST_DISK / 1e6))
    return passed(f"{now.free_disk / 1e9:.1f} GB free")


# -- the lease ----------------------------------------------------------------------------------------------------


def _path(now: Situation, wanted: TakeLease) -> Verdict:
    """Every time of the ladder counts from a setpoint's arrival; who sent it sees all of them later by this delay."""
    delay, limit = wanted.path_delay, now.cfg.lease.max_path_delay
    if delay is None or delay <= limit:
        return passed()
    took = f"takes {delay:.2f} s" if math.isfinite(delay) else "is unknown"
    return stands(refuse(Token.SLOW_PATH, took=took, limit=limit))


def _holder(now: Situation, wanted: TakeLease) -> Verdict:
    if not now.holder or now.lease_left <= 0 or wanted.force:
        return passed()
    return stands(refuse(Token.LEASE_HELD, holder=now.holder, left=now.lease_left))


def _released(now: Situation) -> Verdict:
    is_releasing = not now.holder and now.phase is Phase.RELEASING
    return when(refuse(Token.BUSY, detail="a release is under way") if is_releasing else None)


def _check(
    name: str,
    concerns: tuple[Concern, ...],
    stands: str,
    look: Callable[[Situation], Verdict],
    *tokens: Token,
    rule: Rule = Rule.BEGINNING,
) -> Row:
    """A check before a flight, as `mkctl preflight` shows it."""
    return Row(name=name, concerns=concerns, stands=stands, tokens=tokens, look=at(look), rule=rule, is_shown=True)


def _entry(name: str, stands: str, look: Look, *, rule: Rule = Rule.ENTRY, concerns: tuple[Concern, ...]) -> Row:
    """A condition that the stream waits for."""
    return Row(name=name, concerns=concerns, stands=stands, tokens=(Token.NOT_READY,), look=look, rule=rule)


def _once(row: Row) -> Row:
    """A row that nobody asks when a flight goes on whose sticks had no answer.

    Where a pilot flew meanwhile the aircraft is as he left it, and what is compared with sticks says nothing.
    """
    return replace(row, is_asked_again=False)


_LEASE: Final = (Concern.LEASE,)
_NOT_LANDING: Final = tuple(kind for kind in BY_TARGET if kind is not Concern.LAND)
_IN_SIGHT: Final = tuple(kind for kind in BY_TARGET if kind is not Concern.TAKE_OFF)
_TAKE_OFF: Final = (Concern.TAKE_OFF,)

LEASE_ROWS: Final = (
    Row(
        name="way to the client",
        concerns=_LEASE,
        stands="the way to the client and back takes longer than `control.lease.max_path_delay`, or nobody knows",
        tokens=(Token.SLOW_PATH,),
        look=_path,
        is_early=True,
    ),
    _check("guard", _LEASE, "the guard process is gone", _guard, Token.GUARD_DEAD),
    _check(
        "firmware and layout",
        _LEASE,
        "the firmware is unknown, or has no external control",
        _firmware,
        Token.NO_CONTROL,
    ),
    _check("link", _LEASE, "the link is not up or degraded", _link, Token.LINK_DOWN),
    _check(
        "gate",
        _LEASE,
        "ExternalControl of the active set is 128 or less, or a constant that `control.lease.allow_constant_gate` does "
        "not accept",
        _gate,
        Token.GATE_SHUT,
        Token.GATE_CONSTANT,
    ),
    _check(
        "gate and height control",
        _LEASE,
        "the switch of the gate also turns height control on",
        _gate_alone,
        Token.GATE_SWITCHES_ALTITUDE,
    ),
    Row(
        name="holder",
        concerns=_LEASE,
        stands="another client holds the lease, and the request does not say `force`",
        tokens=(Token.LEASE_HELD,),
        look=_holder,
    ),
    Row(
        name="release under way",
        concerns=_LEASE,
        stands="a release is under way and nobody holds the lease",
        tokens=(Token.BUSY,),
        look=at(_released),
    ),
)
"""What stands in the way of the lease; what keeps the boards busy does, too: see `boardrows`."""

FLIGHT_ROWS: Final = (
    Row(
        name="frame",
        concerns=(Concern.VELOCITY, Concern.POSITION),
        stands="it is given in frame home",
        tokens=(Token.NO_FRAME,),
        look=frame,
        rule=Rule.ALWAYS,
    ),
    Row(
        name="estimate",
        concerns=_IN_SIGHT,
        stands="no camera has seen a target yet",
        tokens=(Token.NO_ESTIMATE,),
        look=estimate,
        rule=Rule.ALWAYS,
    ),
    Row(
        name="one target",
        concerns=BY_TARGET,
        stands=f"it names no target, and two are in sight, or the one of a take-off is more than {ASIDE:g} m aside",
        tokens=(Token.TARGET_UNCLEAR,),
        look=one_target,
    ),
    Row(
        name="target that is flown by",
        concerns=BY_TARGET,
        stands="it names another target than the one that is flown by",
        tokens=(Token.TARGET_UNCLEAR,),
        look=flown_target,
        rule=Rule.ALWAYS,
    ),
    _check(
        "link losses",
        _NOT_LANDING,
        f"more than {MOST_LOSS:g} % of the link tests are not answered in time",
        _losses,
        Token.LINK_POOR,
    ),
    _check(
        "height control",
        BY_TARGET,
        "height control is on, or the active set allows it",
        _height_control,
        Token.HEIGHT_CONTROL,
    ),
    _check("GPS switch", BY_TARGET, "the pilot's GPS switch is not at free", _gps_switch, Token.GPS_STEERS),
    _check(
        "emergency throttle",
        _NOT_LANDING,
        f"NotGas is more than {100 * HIGHEST_EMERGENCY:g} % of the hover throttle",
        _emergency,
        Token.EMERGENCY_CLIMBS,
    ),
    Row(
        name="emergency descent",
        concerns=_NOT_LANDING,
        stands=f"NotGas is less than {100 * LOWEST_EMERGENCY:g} % of the hover throttle, or NotGasZeit is 0",
        tokens=(Token.EMERGENCY_FALLS,),
        look=at(_emergency_gentle),
        rule=Rule.ADVICE,
        is_shown=True,
    ),
    _check(
        "aircraft model",
        BY_TARGET,
        "a gain of the active set is on a potentiometer, or zero",
        _model,
        Token.GAIN_ON_POTI,
        Token.GAIN_ZERO,
    ),
    _check(
        "control loop",
        BY_TARGET,
        "the loop with the configured limits is not safe on the model of this aircraft",
        _loop,
        Token.LOOP_UNSTABLE,
    ),
    _check(
        "receiver",
        _NOT_LANDING,
        f"the receiver quality is below {100 * LEAST_QUALITY:g} %, or the FlightCtrl lands by itself",
        _receiver,
        Token.RECEIVER_WEAK,
    ),
    _check(
        "battery",
        _NOT_LANDING,
        "the board says that it is low, or a cell is below the voltage of the active set",
        _battery,
        Token.BATTERY_LOW,
    ),
    _check(
        "battery cells",
        _NOT_LANDING,
        "the battery may have one cell more than its voltage shows, and the configuration does not say how many",
        _cells,
        Token.CELLS_DOUBTFUL,
        rule=Rule.ADVICE,
    ),
    _check(
        "camera",
        BY_TARGET,
        "every camera is still being opened, gone, silent or not calibrated",
        camera,
        Token.CAMERA_UNFIT,
        Token.CAMERA_OPENING,
    ),
    _check(
        "agreement of cameras",
        BY_TARGET,
        "a camera contradicts the others",
        agreement,
        Token.CAMERAS_CONTRADICT,
    ),
    _check(
        "scale of heights",
        BY_TARGET,
        "the barometer contradicts the heights that images show, and it is no accident",
        heights,
        Token.HEIGHTS_CONTRADICTED,
    ),
    _check(
        "age of images",
        BY_TARGET,
        f"half of the images are older than {LATEST_IMAGES:g} ms when they have been looked at",
        lateness,
        Token.IMAGES_LATE,
    ),
    _check("target", BY_TARGET, "never; it says when the target was last in sight", target),
    _once(
        _check(
            "time stamps",
            BY_TARGET,
            f"camera and boards move more than {1000 * STAMP_LIMIT:g} ms apart, or against each other",
            stamps,
            Token.CAMERA_TURNED,
            Token.STAMPS_OFF,
        )
    ),
    _check(
        "disk",
        _NOT_LANDING,
        f"less than {LEAST_DISK / 1e6:g} MB are free where flights are recorded",
        _disk,
        Token.DISK_FULL,
    ),
    Row(
        name="take-off from the ground",
        concerns=_TAKE_OFF,
        stands="sticks or attitudes of a client are being flown",
        tokens=(Token.NOT_ON_GROUND,),
        look=at(on_ground),
    ),
    _entry(
        "board that listens",
        "a board works on a request and does not listen",
        board_listens,
        rule=Rule.WAITS,
        concerns=MANOEUVRES,
    ),
    Row(
        name="answer to the sticks",
        concerns=BY_TARGET,
        stands="a board reports the gate shut, or the aircraft that is flown does not answer its sticks",
        tokens=(Token.NO_ANSWER,),
        look=answer,
        rule=Rule.WAITS,
    ),
    Row(
        name="ground contact",
        concerns=BY_TARGET,
        stands="a take-off that no image has shown off the ground is flown, or the last centimetres of a landing",
        tokens=(Token.NOT_FLYING,),
        look=off_ground,
        rule=Rule.ALWAYS,
    ),
    Row(
        name="flying aircraft",
        concerns=_IN_SIGHT,
        stands=f"motors stand still, the board says that it does not fly, or its feet are no more than "
        f"{100 * STANDS:g} cm above the target",
        tokens=(Token.NOT_FLYING,),
        look=in_air,
        rule=Rule.ENTRY,
    ),
    _entry("named target", "it names another target than the one in sight", named_target, concerns=_IN_SIGHT),
    _entry("fresh image", "the newest image is older than `entry_age`", fresh_image, concerns=_IN_SIGHT),
    _once(_entry("speed", "it moves faster than `entry_speed` against the target", slow, concerns=_IN_SIGHT)),
    _once(_entry("offset", "it is more than `entry_offset` of its height beside the target", near, concerns=_IN_SIGHT)),
    _entry("certainty", "the standard deviation of its position is above `entry_sd`", certain, concerns=_IN_SIGHT),
    _once(
        _entry(
            "clean images",
            "images have agreed with the model for less than `entry_clean`",
            clean,
            concerns=_IN_SIGHT,
        )
    ),
    _entry("running motors", "motors stand still", motors_run, rule=Rule.WAITS, concerns=_TAKE_OFF),
    _entry(
        "feet on the ground",
        f"its feet are more than {100 * STANDS:g} cm above the target",
        feet_down,
        rule=Rule.WAITS,
        concerns=_TAKE_OFF,
    ),
    _entry(
        "throttle at its lowest",
        f"it flies with more than {100 * CARRIES:g} % of the hover throttle",
        throttle_low,
        rule=Rule.WAITS,
        concerns=_TAKE_OFF,
    ),
)
"""What stands in the way of a manoeuvre. `entry_...` are options of `control.autopilot`."""

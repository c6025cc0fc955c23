"""The table of checks before a flight: what each one finds, and what it prevents."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.config.control import LeaseConfig
from mkdaemon.control.activeset import UNREAD, ActiveSet, Gate, GateKind
from mkdaemon.control.checks import CHECKS, findings, is_ready, standing
from mkdaemon.control.estimator.model import Gap, ModelUnknown
from mkdaemon.control.knowledge import Knowledge
from mkdaemon.control.motionmatch import Match
from mkdaemon.telemetry.control import ControlLine
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, RoundTripStats
from mkdaemon.telemetry.preflight import Blocks, CheckState
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import Battery, Flight, GpsMode, Pilot
from mkdaemon.telemetry.vision import Alarm, EyeState, VisionStats
from tests.control.events import STAMP, flight, link_state, pilot

SET = ActiveSet(Gate(GateKind.CHANNEL, 255), "Easy", emergency_throttle=110, emergency_time=90, low_cell=3.2)

SHARED = Gate(GateKind.CHANNEL, 255, altitude_channel=5)


def health(*, lost=0, sent=50):
    echo = RoundTripStats(sent=sent, lost=lost, loss_percent=100.0 * lost / sent if sent else 0.0)
    return LinkHealth(stamp=STAMP, state=link_state(), echo=echo, confirm=RoundTripStats())


def battery(voltage, *, is_low=None):
    return Battery(stamp=STAMP, source="nc/osd", voltage=voltage, current=None, used_mah=None, is_low=is_low)


def eyes(state=EyeState.OK, alarms=None, reason="", **more):
    fields = {"state": state, "alarms": alarms or {}, "reason": reason, "processed": 9, "latency_p50_ms": 80.0}
    return VisionStats.model_construct(stamp=STAMP, camera="down", **(fields | more))


def reception(quality):
    return Pilot.model_copy(pilot(0.0), update={"rc_quality": quality})


def flags(**flags):
    return Flight.model_copy(flight(is_flying=False), update=flags)


GOOD = Knowledge(
    now=1.0,
    lease=LeaseConfig(),
    hover_gas=125.0,
    line=ControlLine("v2"),
    link=link_state(),
    health=health(),
    active_set=SET,
    flight=flight(is_flying=False),
    pilot=pilot(0.0),
    battery=battery(16.0),
    highest_voltage=16.0,
    eyes=(eyes(),),
    target_age=0.1,
    stamps=Match(0.01, 0.95),
    free_disk=5e9,
)

STANDS = [
    ("guard", "guard_dead", {"has_guard": False}),
    ("firmware and layout", "no_control", {"line": ControlLine(reason="FC 0.1 is not known")}),
    ("link", "link_down", {"link": None}),
    ("link", "link_down", {"link": link_state(LinkCondition.ONE_WAY)}),
    ("link losses", "link_poor", {"health": health(lost=11)}),
    ("gate", "gate_shut", {"active_set": replace(SET, gate=Gate(GateKind.CONSTANT, 128))}),
    ("gate", "gate_constant", {"active_set": replace(SET, gate=Gate(GateKind.CONSTANT, 129))}),
    ("gate and height control", "gate_switches_altitude", {"active_set": replace(SET, gate=SHARED)}),
    ("height control", "height_control", {"active_set": replace(SET, has_height_control=True)}),
    ("height control", "height_control", {"flight": flags(altitude_control=True)}),
    ("GPS switch", "gps_steers", {"flight": flags(gps_mode=GpsMode.HOLD)}),
    ("GPS switch", "gps_steers", {"flight": flags(gps_mode=GpsMode.COME_HOME)}),
    ("emergency throttle", "emergency_climbs", {"active_set": replace(SET, emergency_throttle=119)}),
    ("emergency descent", "emergency_falls", {"active_set": replace(SET, emergency_throttle=65)}),
    ("emergency descent", "emergency_falls", {"active_set": replace(SET, emergency_time=0)}),
    ("aircraft model", "gain_on_poti", {"model": ModelUnknown(Gap.ON_POTENTIOMETER, "gyro_i", 255, 1)}),
    ("aircraft model", "gain_zero", {"model": ModelUnknown(Gap.NO_AIRCRAFT, "stick_p", 0)}),
    ("control loop", "loop_unstable", {"loop": refuse(Token.LOOP_UNSTABLE, detail="x", cause="y", remedy="z")}),
    ("receiver", "receiver_weak", {"pilot": reception(0.7)}),
    ("receiver", "receiver_weak", {"flight": flags(emergency_landing=True)}),
    ("battery", "battery_low", {"battery": battery(16.0, is_low=True)}),
    ("battery", "battery_low", {"battery": battery(12.7)}),
    ("battery", "battery_low", {"flight": flags(battery_low=True)}),
    ("camera", "camera_unfit", {"eyes": (eyes(EyeState.GONE, reason="unplugged"),)}),
    ("camera", "camera_unfit", {"eyes": (eyes(alarms={Alarm.UNCALIBRATED: "no calibration"}),)}),
    ("agreement of cameras", "cameras_contradict", {"contradicting": ("forward",)}),
    ("age of images", "images_late", {"eyes": (eyes(latency_p50_ms=501.0), eyes(latency_p50_ms=900.0))}),
    ("time stamps", "camera_turned", {"stamps": Match(0.0, -0.9)}),
    ("time stamps", "stamps_off", {"stamps": Match(0.05, 0.9)}),
    ("time stamps", "stamps_off", {"stamps": Match(-0.05, 0.9)}),
    ("disk", "disk_full", {"free_disk": 1e8}),
]  # fmt: skip

UNKNOWN = [
    ("link losses", {"health": None}),
    ("link losses", {"health": health(sent=0)}),
    ("gate", {"active_set": UNREAD}),
    ("gate and height control", {"active_set": UNREAD}),
    ("height control", {"active_set": UNREAD}),
    ("GPS switch", {"flight": None}),
    ("GPS switch", {"flight": flags(gps_mode=GpsMode.UNKNOWN)}),
    ("emergency throttle", {"active_set": UNREAD}),
    ("emergency descent", {"active_set": replace(SET, emergency_throttle=None)}),
    ("aircraft model", {"model": ModelUnknown(Gap.UNREAD)}),
    ("receiver", {"pilot": None}),
    ("battery", {"battery": None}),
    ("camera", {"eyes": ()}),
    ("camera", {"now": 10.0}),
    ("age of images", {"eyes": (eyes(processed=0),)}),
    ("age of images", {"now": 10.0}),
    ("target", {"target_age": None}),
    ("target", {"target_age": 1.1}),
    ("time stamps", {"stamps": None}),
    ("time stamps", {"stamps": Match(0.2, 0.5)}),
    ("control loop", {"is_loop_known": False}),
    ("disk", {"free_disk": None}),
]


def finding(known, name):
    return next(found for found in findings(known) if found.name == name)


def test_all_is_well():
    found = findings(GOOD)
    assert [each.name for each in found if each.state is not CheckState.PASSED] == []
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert is_ready(found)


@pytest.mark.parametrize(("name", "token", "change"), STANDS)
def test_what_stands_is_refused_with_a_reason_and_a_remedy(name, token, change):
    known = replace(GOOD, **change)
    found = finding(known, name)
    assert (found.state, found.token) == (CheckState.STANDS, token)
    assert found.reason
    assert found.fix
    assert token in [refusal.token for refusal in standing(known, found.blocks)]
    assert is_ready(findings(known)) is (found.blocks is Blocks.NOTHING)


@pytest.mark.parametrize(("name", "change"), UNKNOWN)
def test_what_nobody_can_tell_prevents_nothing(name, change):
    known = replace(GOOD, **change)
    assert finding(known, name).state is CheckState.UNKNOWN
    assert is_ready(findings(known))


def test_every_check_can_stand_but_for_the_target_which_the_flight_itself_waits_for():
    assert {check.name for check in CHECKS} - {name for name, _, _ in STANDS} == {"target"}


def test_one_camera_that_sees_is_enough():
    assert finding(replace(GOOD, eyes=(eyes(), eyes(EyeState.SILENT))), "camera").state is CheckState.PASSED


def test_an_accepted_constant_gate_passes():
    gate = replace(SET, gate=Gate(GateKind.CONSTANT, 200))
    known = replace(GOOD, lease=LeaseConfig(allow_constant_gate=True), active_set=gate)
    assert finding(known, "gate").state is CheckState.PASSED


def test_a_battery_without_a_known_cell_voltage_has_only_the_boards_alarm():
    assert finding(replace(GOOD, active_set=replace(SET, low_cell=None), battery=battery(9.0)), "battery").token is None

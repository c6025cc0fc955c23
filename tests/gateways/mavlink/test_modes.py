"""Modes: what a MikroKopter is in, and the numbers each kind of ground station reads."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.modes import (
    ROWS,
    Mode,
    Numbering,
    available_mode,
    current_mode,
    heartbeat,
    mode_now,
    mode_of_custom,
    mode_of_numbers,
    mode_of_standard,
)
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.navi import NaviStage
from mkdaemon.telemetry.state import GpsMode
from tests.gateways.mavlink import rig


def picture_of(*values):
    picture = LinkPicture()
    for value in values:
        picture.take(value, 1.0)
    return picture


@pytest.mark.parametrize(
    ("values", "mode"),
    [
        ((), Mode.STABILIZED),
        ((rig.flight(),), Mode.STABILIZED),
        ((rig.flight(altitude_control=True),), Mode.ALTITUDE),
        ((rig.flight(gps_mode=GpsMode.HOLD),), Mode.POSITION),
        ((rig.flight(gps_mode=GpsMode.COME_HOME), rig.navi(NaviStage.HOME)), Mode.RETURN),
        ((rig.flight(gps_mode=GpsMode.COME_HOME), rig.navi(NaviStage.ROUTE)), Mode.MISSION),
        ((rig.flight(), rig.status(Phase.LEASED, epoch=1)), Mode.STABILIZED),
        ((rig.flight(), rig.status(Phase.FLYING, manoeuvre="position")), Mode.OFFBOARD),
        ((rig.flight(), rig.status(Phase.STALE, manoeuvre="stick")), Mode.OFFBOARD),
        ((rig.flight(), rig.status(Phase.FLYING, manoeuvre="takeoff")), Mode.TAKEOFF),
        ((rig.flight(), rig.status(Phase.FLYING, manoeuvre="land")), Mode.LAND),
        ((rig.flight(), rig.status(Phase.LANDING, manoeuvre="position")), Mode.LAND),
        ((rig.flight(), rig.status(Phase.ABORTED, manoeuvre="position")), Mode.HOLD),
        ((rig.flight(emergency_landing=True), rig.status(Phase.FLYING, manoeuvre="hold")), Mode.LAND),
    ],
)
def test_what_it_is_in(values, mode):
    assert mode_now(picture_of(*values)) is mode


def test_numbers_nobody_flies_are_no_modes_and_all_others_have_a_name():
    assert mode_of_custom(Numbering.ARDUPILOT, 18) is None
    assert mode_of_custom(Numbering.PX4, 8 << 16) is None
    assert mode_of_standard(0) is None
    assert mode_of_numbers(Numbering.PX4, 1, 0) is Mode.STABILIZED
    assert mode_of_numbers(Numbering.PX4, 4, 0) is Mode.HOLD
    assert mode_of_standard(mavlink.MAV_STANDARD_MODE_MISSION) is Mode.MISSION
    rows = [available_mode(index, Numbering.PX4) for index in range(1, len(ROWS) + 1)]
    assert [row.mode_index for row in rows] == list(range(1, len(Mode) + 1))
    assert {row.number_modes for row in rows} == {len(Mode)}
    assert available_mode(0, Numbering.PX4) is None and available_mode(len(ROWS) + 1, Numbering.PX4) is None
    assert current_mode(Mode.LAND, Numbering.ARDUPILOT).custom_mode == 9


@pytest.mark.parametrize(
    ("values", "state"),
    [
        ((), mavlink.MAV_STATE_UNINIT),
        ((rig.flight(motors_running=False),), mavlink.MAV_STATE_STANDBY),
        ((rig.flight(motors_running=None),), mavlink.MAV_STATE_STANDBY),
        ((rig.flight(is_calibrating=True),), mavlink.MAV_STATE_CALIBRATING),
        ((rig.flight(),), mavlink.MAV_STATE_ACTIVE),
        ((rig.flight(battery_low=True),), mavlink.MAV_STATE_CRITICAL),
        ((rig.flight(emergency_landing=True),), mavlink.MAV_STATE_EMERGENCY),
        ((rig.flight(), rig.line(LinkCondition.MUTE)), mavlink.MAV_STATE_UNINIT),
    ],
)
def test_heartbeats(values, state):
    """QGroundControl offers no take-off, landing or go-to for a GENERIC autopilot (`FirmwarePlugin.h`, `isCapable`)."""
    picture = picture_of(*values)
    assert heartbeat(picture, Mode.OFFBOARD, Numbering.AS_PX4).autopilot == mavlink.MAV_AUTOPILOT_PX4
    beat = heartbeat(picture, Mode.OFFBOARD, Numbering.PX4)
    assert (beat.system_status, beat.autopilot, beat.type) == (state, mavlink.MAV_AUTOPILOT_GENERIC, 2)
    is_armed = any(getattr(value, "motors_running", False) for value in values)
    assert bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) is is_armed
    assert beat.custom_mode == 6 << 16

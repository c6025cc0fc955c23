"""Requests of the bus as procedures of the protocol, and their results as replies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from pydantic import ValidationError

from mkdaemon.bus.codec import first_mistake
from mkdaemon.errors import CommandRejectedError, MkError, ProtocolError
from mkdaemon.frames import geodetic_from_enu
from mkdaemon.protocol.flags import MotorControllerBits
from mkdaemon.protocol.messages import Mixer, MotorController, WriteMixer
from mkdaemon.protocol.procedures.live_set import differing
from mkdaemon.protocol.procedures.mixer import read_mixer, write_mixer
from mkdaemon.protocol.procedures.motor_controllers import change_motor_controller, read_motor_controller
from mkdaemon.protocol.procedures.points import from_points, read_format, to_points
from mkdaemon.protocol.procedures.route import activate_route, switch_words
from mkdaemon.protocol.procedures.settings_slots import Restoration, backup_settings, edit_settings, restore_settings
from mkdaemon.protocol.procedures.steps import Patience, Procedure, Progress
from mkdaemon.protocol.procedures.waypoint_list import (
    FinishedUpload,
    clear_points,
    content_hash,
    download_points,
    upload_points,
    verify_points,
)
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import change_by_name
from mkdaemon.telemetry import mission, settings
from mkdaemon.telemetry.mission import Mission, MissionPoint
from mkdaemon.telemetry.navi import NaviGotoRequest, NaviTarget
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import Position

PATIENCE: Final = Patience(attempts=12, timeout=0.5)
"""With each request: a NaviCtrl that writes its card says nothing for 2 s, one that streams too much for 4 s. Source:
docs/firmware-notes, "Timing" and "Losses"."""


def settings_backup(request: settings.SettingsBackupRequest) -> Procedure[settings.SettingsBackup]:
    """Read parameter sets."""
    found = yield from backup_settings(PATIENCE, request.slots)
    return settings.SettingsBackup(firmware=found.version.release, active=found.active, sets=_stored(found.sets))


def settings_compare(request: settings.SettingsCompareRequest) -> Procedure[settings.SettingsComparison]:
    """Read the sets asked about and compare."""
    wanted = {one.slot: one.raw for one in request.sets}
    found = yield from backup_settings(PATIENCE, tuple(sorted(wanted)))
    stored = {slot: found.sets[slot] for slot in sorted(wanted)}
    return settings.SettingsComparison(
        firmware=found.version.release,
        active=found.active,
        stored=_stored(stored),
        differing=tuple(slot for slot, raw in stored.items() if differing(wanted[slot], raw)),
    )


def settings_restore(request: settings.SettingsRestoreRequest) -> Procedure[settings.SettingsRestoration]:
    """Write the sets that differ."""
    wanted = {one.slot: one.raw for one in request.sets}
    return _restoration((yield from restore_settings(wanted, PATIENCE, dry_run=request.dry_run)))


def settings_write(request: settings.SettingsWriteRequest) -> Procedure[settings.SettingsRestoration]:
    """Change parameters by name."""

    def change(raw: bytes) -> bytes:
        try:
            return change_by_name(ParameterSet.from_payload(raw), request.values).raw
        except ProtocolError as error:
            raise refuse(Token.BAD_VALUE, detail=str(error)) from error

    return _restoration((yield from edit_settings(request.slot, change, PATIENCE, dry_run=request.dry_run)))


def waypoints_upload(request: mission.WaypointsUploadRequest) -> Procedure[mission.WaypointsStored]:
    """Replace the list and read it back."""
    form = yield from read_format(PATIENCE)
    points = to_points(_mission(request.points), form)
    try:
        done = yield from upload_points(points, PATIENCE)
    except MkError as error:
        raise _list_left(error) from error
    return _stored_list(done)


def waypoints_clear(request: mission.WaypointsClearRequest) -> Procedure[mission.WaypointsStored]:
    """Empty the list."""
    form = yield from read_format(PATIENCE)
    yield Progress(0, 1, "clearing")
    try:
        yield from clear_points(form.kind, PATIENCE)
    except MkError as error:
        raise _list_left(error) from error
    return mission.WaypointsStored(count=0, digest=content_hash(()))


def waypoints_read(request: mission.WaypointsReadRequest) -> Procedure[mission.WaypointList]:
    """Read the list."""
    form = yield from read_format(PATIENCE)
    points = yield from download_points(form.kind, PATIENCE)
    return mission.WaypointList(points=from_points(points, form).points, digest=content_hash(points))


def waypoints_verify(request: mission.WaypointsVerifyRequest) -> Procedure[mission.WaypointsComparison]:
    """Compare the list with a mission."""
    form = yield from read_format(PATIENCE)
    points = to_points(_mission(request.points), form)
    found = yield from verify_points(points, PATIENCE)
    return mission.WaypointsComparison(
        digest=content_hash(points), differences=tuple(str(difference) for difference in found)
    )


def route_start(request: mission.RouteStartRequest) -> Procedure[mission.RouteStarted]:
    """Make the list ready to be flown by the pilot's switch."""
    form = yield from read_format(PATIENCE)
    count = yield from activate_route(form, PATIENCE)
    return mission.RouteStarted(count=count, switch=switch_words(form))


def navi_goto(point: MissionPoint) -> Procedure[NaviTarget]:
    """Make a place the only point of the list, ready to be flown by the pilot's switch."""
    form = yield from read_format(PATIENCE)
    try:
        done = yield from upload_points(to_points(_mission((point,)), form), PATIENCE)
        yield from activate_route(form, PATIENCE)
    except MkError as error:
        raise _list_left(error) from error
    return NaviTarget(**dict(_stored_list(done)), switch=switch_words(form))


def target_point(request: NaviGotoRequest, position: Position | None) -> MissionPoint:
    """Return the place a request means, from the home position that the NaviCtrl tells; admission made sure of one."""
    assert position is not None
    assert position.home_latitude_deg is not None
    assert position.home_longitude_deg is not None
    east, north, up = request.position
    home = (math.radians(position.home_latitude_deg), math.radians(position.home_longitude_deg), 0.0)
    latitude, longitude, _ = geodetic_from_enu(east, north, 0.0, home)
    return MissionPoint(
        latitude_deg=math.degrees(latitude),
        longitude_deg=math.degrees(longitude),
        altitude=up,
        radius=request.radius,
        hold=request.hold,
        heading_deg=request.heading_deg,
    )


def route_end(request: mission.RouteEndRequest) -> Procedure[mission.WaypointsStored]:
    """Empty the list in flight."""
    return (yield from waypoints_clear(mission.WaypointsClearRequest(in_flight=True)))


def mixer_read(request: settings.MixerReadRequest) -> Procedure[settings.MixerTable]:
    """Read the mixer."""
    return _mixer((yield from read_mixer(PATIENCE)))


def mixer_write(request: settings.MixerWriteRequest) -> Procedure[settings.MixerTable]:
    """Store a mixer and read it back."""
    wanted = WriteMixer(name=request.name, motors=request.motors)
    return _mixer((yield from write_mixer(wanted, PATIENCE)))


def motor_controllers_read(request: settings.MotorControllersReadRequest) -> Procedure[settings.MotorControllers]:
    """Read motor controllers one after the other."""
    found = []
    for done, motor in enumerate(request.motors):
        yield Progress(done, len(request.motors), f"reading motor controller {motor}")
        found.append(_controller((yield from read_motor_controller(motor, PATIENCE))))
    return settings.MotorControllers(controllers=tuple(found))


def motor_controllers_write(request: settings.MotorControllersWriteRequest) -> Procedure[settings.MotorControllers]:
    """Change items of one motor controller."""
    given = {
        "pwm_scaling": request.pwm_scaling,
        "current_limit": request.current_limit,
        "temperature_limit": request.temperature_limit,
        "current_scaling": request.current_scaling,
    }
    stored = yield from change_motor_controller(
        request.motor, given, PATIENCE, reverse=request.reverse, save=request.save
    )
    return settings.MotorControllers(controllers=(_controller(stored),))


def _stored(sets: Mapping[int, bytes]) -> tuple[settings.StoredSet, ...]:
    return tuple(settings.StoredSet(slot=slot, raw=raw) for slot, raw in sets.items())


def _restoration(done: Restoration) -> settings.SettingsRestoration:
    return settings.SettingsRestoration(
        firmware=done.version.release,
        active=done.active,
        before=_stored(done.before),
        stored=_stored(done.stored),
        written=done.written,
    )


def _stored_list(done: FinishedUpload) -> mission.WaypointsStored:
    return mission.WaypointsStored(count=done.count, digest=done.digest, rounds=done.rounds, writes=done.writes)


def _mission(points: tuple[MissionPoint, ...]) -> Mission:
    try:
        return Mission(points=points)
    except ValidationError as error:
        raise refuse(Token.BAD_VALUE, detail=first_mistake(error)) from error


def _list_left(error: MkError) -> CommandRejectedError:
    """Say what is left where neither a board nor the daemon has named it."""
    return error if isinstance(error, CommandRejectedError) else refuse(Token.LIST_INCOMPLETE, detail=str(error))


def _mixer(found: Mixer) -> settings.MixerTable:
    return settings.MixerTable(name=found.name, motors=found.motors)


def _controller(found: MotorController) -> settings.ControllerSettings:
    fields = {name: int(getattr(found, name)) for name in settings.ControllerSettings.model_fields if name != "reverse"}
    return settings.ControllerSettings(**fields, reverse=bool(found.bits & MotorControllerBits.REVERSE))

"""What each command does to a MikroKopter: the table of handlers.

The daemon flies against the target in sight, the NaviCtrl by GPS when the pilot turns his switch: a place in a local
frame is the daemon's, a place on the globe is the NaviCtrl's. Motors are started and stopped by the pilot's sticks, on
stock firmware by nothing else.
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.frames import enu_from_geodetic
from mkdaemon.gateways.mavlink.commands import LOCAL_FRAMES, Asked, CommandAnswered, Handler, accepted, denied
from mkdaemon.gateways.mavlink.dialect import mavlink
from mkdaemon.gateways.mavlink.frames import Vector3, compass_from_yaw, ned_from_enu
from mkdaemon.gateways.mavlink.handcontrol import HandControl
from mkdaemon.gateways.mavlink.modes import Mode, Numbering, is_armed, mode_of_custom, mode_of_numbers, mode_of_standard
from mkdaemon.gateways.mavlink.parameters import ParameterServer
from mkdaemon.gateways.mavlink.paths import FROM_THE_FIRST, PathMission
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.steering import ManualSteering, Order
from mkdaemon.gateways.mavlink.texts import INFO, REMEDIES, WARNING, Notify
from mkdaemon.protocol import Board
from mkdaemon.protocol.messages import ArmMotors
from mkdaemon.telemetry.control import ControlEstimate
from mkdaemon.telemetry.navi import ControlNavi
from mkdaemon.telemetry.preflight import Blocks, CheckState
from mkdaemon.telemetry.state import Flight, Position

_FORCE: Final = 21_196
"""Second parameter of a disarm that stops the motors of a flying aircraft."""
_ABOVE_SEA: Final = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})
_ABOVE_HOME: Final = frozenset({mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_PILOTS: Final = "the pilot turns his GPS switch to coming home: nothing on the serial line flies it"


class Actions:
    """Commands that fly, or look as if they would."""

    def __init__(
        self,
        uav: Vehicle,
        picture: LinkPicture,
        steering: ManualSteering,
        hands: HandControl,
        notify: Notify,
        parameters: ParameterServer,
        path: PathMission,
    ) -> None:
        """Act for ground stations.

        Args:
            uav: the vehicle.
            picture: what is known of it.
            steering: flies.
            hands: the setpoints that ground stations stream.
            notify: tells a ground station what was found.
            parameters: of the gateway.
            path: a mission in a local frame.
        """
        self._uav, self._picture, self._steering, self._hands = uav, picture, steering, hands
        self._notify, self._parameters, self._path = notify, parameters, path

    def table(self) -> dict[int, Handler]:
        """Handlers by the number of the command."""
        refusals = {number: self._refuse(words) for number, words in _REFUSED.items()}
        return refusals | {
            mavlink.MAV_CMD_NAV_TAKEOFF: self.take_off,
            mavlink.MAV_CMD_NAV_LAND: self.land,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: self.return_home,
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: self.hold,
            mavlink.MAV_CMD_DO_REPOSITION: self.reposition,
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE: self.pause,
            mavlink.MAV_CMD_DO_SET_MODE: self.set_mode,
            mavlink.MAV_CMD_DO_SET_STANDARD_MODE: self.set_standard_mode,
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self.arm,
            mavlink.MAV_CMD_MISSION_START: self.start_mission,
            mavlink.MAV_CMD_DO_SET_ROI_LOCATION: self.look_at,
            mavlink.MAV_CMD_DO_SET_ROI: self.look_at,
            mavlink.MAV_CMD_DO_SET_ROI_NONE: self.hold_heading,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: self.check,
        }

    @staticmethod
    def _refuse(words: str) -> Handler:
        return lambda _: denied(words)

    async def take_off(self, asked: Asked) -> CommandAnswered:
        """NAV_TAKEOFF: by the daemon over the target, when the pilot has started the motors."""
        given = asked.number(7)
        height = given or self._parameters.take_off_height
        is_above_sea = asked.frame in _ABOVE_SEA or (
            asked.frame is None and asked.by.station.numbering is Numbering.AS_PX4  # so PX4 reads a COMMAND_LONG
        )
        if given and is_above_sea:
            ground = self._picture.ground
            if ground is None:
                return denied("the height of the ground above the sea is not known: give the height above home")
            height -= ground
        if not is_armed(self._picture):
            return denied(_START_MOTORS)
        return await self._fly(asked, "takeoff", {"height": height}, "takes off")

    async def land(self, asked: Asked) -> CommandAnswered:
        """NAV_LAND: by the daemon on the target in sight, wherever the command says."""
        return await self._fly(asked, "land", {"yaw": None}, "lands on the target in sight")

    async def hold(self, asked: Asked) -> CommandAnswered:
        """NAV_LOITER_UNLIM: the daemon holds the place over the target; a path is ended."""
        return await self._fly(asked, "hold", {}, "")

    async def enter_hold(self, asked: Asked) -> CommandAnswered:
        """The mode Hold: a path is paused, for MAVSDK and QGroundControl pause a mission so; else as `hold`."""
        if self._path.is_flown_for(asked.by):
            return await self._path.pause(asked, is_paused=True)
        return await self.hold(asked)

    async def pause(self, asked: Asked) -> CommandAnswered:
        """DO_PAUSE_CONTINUE: pausing holds the place; a list of the NaviCtrl is paused by the pilot's switch."""
        if asked.number(1) != 0:
            if self._path.held is not None:
                return await self._path.pause(asked, is_paused=False)
            return denied(f"only the NaviCtrl goes on with something: {_PILOTS}")
        if self._steering.order is None:
            await self._uav.abort("asked for by a ground station")
            return accepted()
        return await self.enter_hold(asked)

    async def reposition(self, asked: Asked) -> CommandAnswered:
        """DO_REPOSITION: in a local frame by the daemon, on the globe by the NaviCtrl."""
        if asked.frame in LOCAL_FRAMES:
            north, east, down = (asked.number(index) for index in (5, 6, 7))
            if north is None or east is None or down is None:
                return denied("a place in a local frame needs x, y and z")
            return await self._fly_to(asked, ned_from_enu((north, east, down)), _yaw(asked.number(4)))
        if asked.number(5) is None and asked.number(6) is None:
            return await self._reposition_above(asked)
        return await self._reposition_on_globe(asked)

    async def _reposition_above(self, asked: Asked) -> CommandAnswered:
        """DO_REPOSITION without a place: QGroundControl pauses, changes the height or turns a PX4 so."""
        heading, height = asked.number(4), asked.number(7)
        if heading is None and height is None:
            return await self.enter_hold(asked)
        estimate, here = self._picture.get(ControlEstimate), self._picture.get(Position)
        if estimate is None or self._steering.order is None:
            return denied("a height or a heading alone needs a flight by the target in sight")
        x, y, up = estimate.position
        if height is not None:
            found = None if here is None else self._height_above_home(asked, height, here)
            if found is None:
                return denied(_NO_GROUND)
            up = found
        return await self._fly_to(asked, (x, y, up), _yaw(heading))

    async def _reposition_on_globe(self, asked: Asked) -> CommandAnswered:
        if self._steering.order is not None:
            return denied(
                "the aircraft is flown by the target in sight, and a place on the globe is the NaviCtrl's: give a "
                "place in LOCAL_NED, or give the aircraft back (mode Stabilized)"
            )
        here = self._picture.get(Position)
        if here is None or here.home_latitude_deg is None or here.home_longitude_deg is None:
            return denied("no GPS position, or no home position: start the motors with a fix, for that sets home")
        latitude, longitude, height = asked.number(5), asked.number(6), asked.number(7)
        if latitude is None or longitude is None:
            return denied("a place on the globe needs latitude and longitude")
        up = self._height_above_home(asked, height, here)
        if up is None:
            return denied(_NO_GROUND)
        home = (math.radians(here.home_latitude_deg), math.radians(here.home_longitude_deg), 0.0)
        east, north, _ = enu_from_geodetic(math.radians(latitude), math.radians(longitude), 0.0, home)
        turn = asked.number(4)
        heading = None if turn is None else round(math.degrees(turn)) % 360 or 360
        target = await self._uav.navi.target((east, north, up), confirm=True, heading_deg=heading)
        return accepted(f"the NaviCtrl has the target: {target.switch}")

    def _height_above_home(self, asked: Asked, height: float | None, here: Position) -> float | None:
        """Height of a place above home [m]; the present height if none is given; None if it is unknown."""
        if height is None:
            return here.altitude_above_start
        if asked.frame in _ABOVE_HOME:
            return height
        ground = self._picture.ground
        return None if ground is None else height - ground

    async def return_home(self, asked: Asked) -> CommandAnswered:
        """NAV_RETURN_TO_LAUNCH: the pilot's switch flies home, where the NaviCtrl holds no list that it would fly."""
        if self._steering.order is not None:
            self._steering.give_back(asked.by)
            return accepted(f"the aircraft is given back to the pilot; {_PILOTS}, home")
        navi = self._picture.get(ControlNavi, is_old=True)  # it comes on change
        if navi is None:
            return denied("whether the NaviCtrl holds a list, which the same switch would fly, is not known")
        if navi.waypoints:
            return denied(f"the NaviCtrl holds {navi.waypoints} points, which the same switch flies: clear the mission")
        return accepted(f"{_PILOTS}, home")

    async def start_mission(self, asked: Asked) -> CommandAnswered:
        """MISSION_START: a path is flown; a list is made ready for the pilot's switch."""
        if self._path.held is not None:
            return await self._path.start(asked)
        if self._steering.order is not None:
            return denied("the aircraft is flown by the target in sight: give it back first (mode Stabilized)")
        started = await self._uav.route.start(confirm=True)
        return accepted(started.switch)

    async def arm(self, asked: Asked) -> CommandAnswered:
        """COMPONENT_ARM_DISARM: what is so already is accepted; else only a public fork of the firmware can do it."""
        wants = asked.number(1) == 1
        if wants is is_armed(self._picture) and self._picture.get(Flight) is not None:
            return accepted()
        if not wants:
            await self._uav.stop(in_flight=asked.number(2) == _FORCE)
            return accepted()
        try:
            await self._uav.request(Board.FC, ArmMotors(), confirm=True)
        except MkError as refusal:
            return denied(f"{_START_MOTORS} ({refusal})")
        return accepted()

    async def set_mode(self, asked: Asked) -> CommandAnswered:
        """DO_SET_MODE, in the numbers of the link; without a custom mode by the flags of the base mode."""
        base, main, sub = int(asked.number(1) or 0), int(asked.number(2) or 0), int(asked.number(3) or 0)
        numbering = asked.by.station.numbering
        if not base & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return await self.enter(asked, _mode_of_flags(base))
        mode = mode_of_custom(numbering, main) if main > 0xFF else mode_of_numbers(numbering, main, sub)
        return await self.enter(asked, mode)

    async def set_standard_mode(self, asked: Asked) -> CommandAnswered:
        """DO_SET_STANDARD_MODE."""
        return await self.enter(asked, mode_of_standard(int(asked.number(1) or 0)))

    async def enter(self, asked: Asked, mode: Mode | None) -> CommandAnswered:
        """Enter a mode; see `modes.Mode` for what each is."""
        if mode is None:
            return denied("a MikroKopter has no such mode; AVAILABLE_MODES lists them")
        if mode is Mode.ALTITUDE:
            return denied("height control is a switch of the pilot's transmitter")
        entered = {
            Mode.MISSION: self.start_mission,
            Mode.RETURN: self.return_home,
            Mode.TAKEOFF: self.take_off,
            Mode.LAND: self.land,
            Mode.HOLD: self.enter_hold,
        }
        return await (entered[mode](asked) if mode in entered else self._enter_streamed(asked, mode))

    async def _enter_streamed(self, asked: Asked, mode: Mode) -> CommandAnswered:
        """Fly what the ground station streams; its sticks in Stabilized and Position, its setpoints in Offboard."""
        kind = self._hands.streamed(asked.by, mode)
        if kind is not None:
            await self._steering.fly(Order(asked.by, kind, is_streamed=True, mode=mode))
            return accepted()
        if mode is Mode.STABILIZED:
            if self._steering.order is not None:
                self._steering.give_back(asked.by)
                return accepted("the aircraft is given back to the pilot")
            return accepted()
        if mode is Mode.OFFBOARD:
            return denied("Offboard flies a stream of setpoints: begin it, then set the mode")
        return denied("the pilot's GPS switch holds the place; with MANUAL_CONTROL streamed, Position flies velocities")

    async def look_at(self, asked: Asked) -> CommandAnswered:
        """DO_SET_ROI_LOCATION: turn to a place of the local frame and hold; on the globe only in a mission."""
        if asked.frame not in LOCAL_FRAMES:
            return denied("a region of interest on the globe is flown in a mission only: upload it with the waypoints")
        estimate = self._picture.get(ControlEstimate)
        north, east = asked.number(5), asked.number(6)
        if estimate is None or north is None or east is None:
            return denied("turning to a place needs a flight by the target in sight, and x and y")
        x, y, z = estimate.position
        return await self._fly_to(asked, (x, y, z), math.atan2(north - y, east - x))

    async def hold_heading(self, asked: Asked) -> CommandAnswered:
        """DO_SET_ROI_NONE: keep the heading; does nothing unless the gateway flies."""
        return accepted() if self._steering.order is None else await self.enter_hold(asked)

    async def check(self, asked: Asked) -> CommandAnswered:
        """RUN_PREARM_CHECKS: the checks before a flight, a STATUSTEXT for each that prevents one."""
        if is_armed(self._picture):
            return CommandAnswered(int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED), "the motors turn already")
        report = await self._uav.preflight()
        for finding in report.findings:
            if finding.state is CheckState.STANDS:
                severity = INFO if finding.blocks is Blocks.NOTHING else WARNING
                fix = REMEDIES.get(finding.token or "", finding.fix)
                self._notify(asked.by.station, f"PreArm: {finding.name}: {finding.reason} {fix}", severity)
        return accepted("all checks before a flight passed" if report.is_ready else "")

    async def _fly_to(self, asked: Asked, place: Vector3, yaw: float | None) -> CommandAnswered:
        return await self._fly(asked, "position", {"position": place, "frame": "pad", "yaw": yaw}, "")

    async def _fly(self, asked: Asked, kind: str, fields: dict[str, object], words: str) -> CommandAnswered:
        await self._steering.fly(Order(asked.by, kind, fields))
        return accepted(words)


_NO_GROUND: Final = "the height of home above the sea is not known: give the height above home"
_START_MOTORS: Final = "the pilot starts and stops the motors with his sticks"
_REFUSED: Final = {
    mavlink.MAV_CMD_DO_SET_HOME: "home is where the motors were started with a GPS fix",
    mavlink.MAV_CMD_DO_CHANGE_SPEED: "a speed is part of a waypoint: upload it with the mission",
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: FROM_THE_FIRST,
    mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: "sensors are calibrated by the pilot's sticks, motors off",
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: "boards are reset by `mkctl board send`, motors off",
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: "the pilot ends a flight: gate shut, throttle down",
    mavlink.MAV_CMD_DO_MOTOR_TEST: "motors are tested by `mkctl board motors test`, propellers off",
}
"""Commands that are known and refused, each with what is done instead."""


def _yaw(heading: float | None) -> float | None:
    return None if heading is None else compass_from_yaw(heading)


def _mode_of_flags(base: int) -> Mode | None:
    """The mode that a base mode without a number asks for; what a ground station of a GENERIC autopilot sends."""
    if base & mavlink.MAV_MODE_FLAG_AUTO_ENABLED:
        return Mode.MISSION
    if base & mavlink.MAV_MODE_FLAG_GUIDED_ENABLED:
        return Mode.HOLD
    if base & (mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED):
        return Mode.STABILIZED
    return None

"""Flights of the NaviCtrl's own position control: a target, a route, the way home; and their requests."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from mkdaemon.telemetry.base import Stamped, Telemetry
from mkdaemon.telemetry.mission import WaypointsStored
from mkdaemon.telemetry.procedure import ConfirmedRequest

_Metres = Annotated[float, Field(ge=-5_000.0, le=5_000.0)]


class NaviStage(StrEnum):
    """Stage of the NaviCtrl's own flight."""

    GROUND = "ground"
    """The aircraft does not fly."""
    FREE = "free"
    """The GPS switch is at free and no list is ready: the pilot flies."""
    READY = "ready"
    """A list is ready and is not flown: the GPS switch is not at coming home."""
    HOLD = "hold"
    """The GPS switch is at hold: the NaviCtrl keeps the place."""
    ROUTE = "route"
    """It flies to a waypoint of the list."""
    AT_POINT = "at_point"
    """It has reached a waypoint and stays for the point's hold time."""
    HOME = "home"
    """It flies home, or stays there."""
    OVERRIDDEN = "overridden"
    """The pilot's pitch or roll stick overrides it."""
    NO_POSITION = "no_position"
    """The GPS switch asks for position control and there is no position."""


class NaviFlight(Telemetry):
    """The NaviCtrl's own flight, and what the pilot's hands do now."""

    stage: NaviStage
    """Where it stands."""
    hands: str
    """The pilot's task now, one sentence."""
    waypoint: int
    """Waypoint on the way to, or first to be flown to, from 1; 0 for none."""
    waypoints: int
    """Waypoints of the list."""
    target_distance: float | None
    """To where it flies, over ground [m]; null where it is not known."""
    home_distance: float | None
    """From home, over ground [m]; null where it is not known."""
    height: float | None
    """Above the place of the last calibration, by barometer [m]; null where it is not known."""
    is_route_done: bool
    """The last waypoint of the list was reached."""
    is_home: bool
    """It flies to home or stays within 5 m of it, by the switch or at the end of the list."""


class ControlNavi(Stamped, NaviFlight):
    """The NaviCtrl's own flight: `control/navi`, on change and once a second while its position control is wanted."""


class NaviGotoRequest(ConfirmedRequest):
    """Make a place the NaviCtrl's target: `do/navi_goto`. In flight; the pilot's GPS switch flies there."""

    position: tuple[_Metres, _Metres, _Metres] = Field(strict=False)
    """East, north and up of home [m]. Up is flown only with height control; else the pilot's throttle holds it."""
    heading_deg: int | None = Field(default=None, ge=1, le=360)
    """Compass heading to turn to [deg]; null keeps the heading."""
    radius: int = Field(default=3, ge=1, le=50)
    """The place counts as reached within this distance [m]; GPS is good for 2 to 3 m."""
    hold: int = Field(default=255, ge=1, le=255)
    """Time to stay there [s]; then a NaviCtrl 0.24 flies home."""


class NaviTarget(WaypointsStored):
    """A target that was stored and read back: the answer to `do/navi_goto`."""

    switch: str
    """What the pilot's GPS switch does from now on, in words."""

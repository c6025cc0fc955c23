"""A mission: the points of a flight, independent of any file format and of any NaviCtrl release; and its upload.

Altitudes are above the place where the motors were started, because that is what the NaviCtrl flies by; a file that
gives altitudes above sea level is converted when it is read (`Mission.raised`).
"""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from mkdaemon.described import Described
from mkdaemon.telemetry.base import Stamped, Telemetry
from mkdaemon.telemetry.procedure import ConfirmedRequest, InFlightRequest, ProcedureRequest

AUTOMATIC_CAMERA = 255
"""Camera angle that means "look at the point of interest" [deg on the wire]. Source: docs/protocol.md, `Point`."""


class PointKind(StrEnum):
    """Purpose of a point."""

    WAYPOINT = "waypoint"
    """Fly here."""
    POI = "poi"
    """Look here; never flown to."""
    FAILSAFE = "failsafe"
    """Fly here when the transmitter is lost (NaviCtrl 2.x)."""
    LAND = "land"
    """Land here (NaviCtrl 2.16 and later)."""


class MissionPoint(Described):
    """One point of a mission, SI units, north-referenced compass angles."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    """Geographic latitude, WGS 84 [deg]."""
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    """Geographic longitude, WGS 84 [deg]."""
    altitude: Annotated[float, Field(ge=-500, le=6000)]
    """Height above the starting place [m]."""
    kind: PointKind = PointKind.WAYPOINT
    """What the point is for."""
    radius: Annotated[int, Field(ge=0, le=255)] = 5
    """The point counts as reached within this distance [m]."""
    hold: Annotated[int, Field(ge=0, le=255)] = 0
    """Time to stay once reached [s]."""
    heading_deg: Annotated[int, Field(ge=1, le=360)] | None = None
    """Compass heading to turn to [deg]; none keeps the heading."""
    poi: Annotated[int, Field(ge=1, le=255)] | None = None
    """Number, counted from 1 in this mission, of the point of interest to look at."""
    climb: Annotated[float, Field(ge=0, le=25.5)] = 3.0
    """Rate of climb and descent towards this altitude [m/s]."""
    speed: Annotated[float, Field(ge=0, le=25.5)] = 0.0
    """Ground speed [m/s]; 0 is the fastest the NaviCtrl allows."""
    camera_angle_deg: Annotated[int, Field(ge=0, le=255)] = 0
    """Camera tilt [deg]; 255 tilts to the point of interest."""
    name: Annotated[str, Field(max_length=4, pattern=r"^[\x20-\x7e]*$")] = ""
    """At most four ASCII characters."""
    event: Annotated[int, Field(ge=0, le=255)] = 0
    """Value of the waypoint-event channel while the point is held."""
    photo_distance: Annotated[int, Field(ge=0, le=255)] = 0
    """Distance between two pictures [m]; 0 for none."""

    @model_validator(mode="after")
    def _has_one_heading(self) -> Self:
        if self.heading_deg is not None and self.poi is not None:
            msg = "heading_deg and poi exclude each other: keep one"
            raise ValueError(msg)
        return self


class Mission(Described):
    """Points in the order they are flown, points of interest among them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    points: tuple[MissionPoint, ...]
    """The points; numbered from 1."""
    name: str = ""
    """What the author called it."""

    @model_validator(mode="after")
    def _refers_to_pois(self) -> Self:
        for number, point in enumerate(self.points, 1):
            if point.poi is None:
                continue
            if point.poi > len(self.points) or self.points[point.poi - 1].kind is not PointKind.POI:
                msg = f"point {number} looks at point {point.poi}, which is not a point of interest of this mission"
                raise ValueError(msg)
        return self

    def raised(self, by: float) -> "Mission":
        """Return the mission with every altitude raised [m]; `-elevation` turns heights above sea level into ours.

        Raises:
            ValueError: an altitude leaves the range a point may have.
        """
        shifted = (
            MissionPoint.model_validate({**point.model_dump(), "altitude": round(point.altitude + by, 3)})
            for point in self.points
        )
        return Mission(points=tuple(shifted), name=self.name)


class MissionEvent(Stamped):
    """Change of the waypoint list: `event/mission`."""

    action: str
    """`uploaded` or `cleared`, and read back; `incomplete`: an upload or clearing broke off, do not fly the list;
    `started`: it is ready to be flown by the pilot's switch."""
    count: int
    """Points the NaviCtrl holds now; 0 where that is not known."""
    digest: str
    """SHA-256 of the list as stored, in hexadecimal; equal for equal lists, whichever file they came from; empty where
    it was not read."""
    source: str
    """File the mission came from; empty when cleared."""


class WaypointsUploadRequest(InFlightRequest):
    """Replace the NaviCtrl's list by a mission, read it back and compare: `do/waypoints_upload`."""

    points: tuple[MissionPoint, ...] = Field(strict=False, min_length=1, max_length=254)
    """The points in the order they are flown."""
    source: str = Field(default="", max_length=200)
    """Where they came from, for the event."""
    allow_unusual: bool = False
    """Take points that are more than 5 km away, below the start or more than 500 m above it."""


class WaypointsClearRequest(InFlightRequest):
    """Empty the NaviCtrl's list and see that it is empty: `do/waypoints_clear`."""


class RouteStartRequest(ConfirmedRequest):
    """Make the list ready to be flown by the pilot's GPS switch, in flight: `do/route_start`."""


class RouteStarted(Telemetry):
    """A list that is ready: the answer to `do/route_start`."""

    count: int
    """Points."""
    switch: str
    """What the pilot's GPS switch does from now on, in words."""


class RouteEndRequest(ConfirmedRequest):
    """Empty the list, in flight too: `do/route_end`. With the GPS switch at coming home the aircraft flies home."""


class WaypointsStored(Telemetry):
    """A list that was read back: the answer to `do/waypoints_upload` and `do/waypoints_clear`."""

    count: int
    """Points stored."""
    digest: str
    """SHA-256 of the list as stored, in hexadecimal; equal for equal lists."""
    rounds: int = 0
    """How often the list was read back."""
    writes: int = 0
    """Points written, repetitions included."""


class WaypointsReadRequest(ProcedureRequest):
    """Read the NaviCtrl's list: `do/waypoints_read`."""


class WaypointList(Telemetry):
    """The NaviCtrl's list: the answer to `do/waypoints_read`."""

    points: tuple[MissionPoint, ...]
    """The points in the order they are flown."""
    digest: str
    """SHA-256 of the list as stored, in hexadecimal."""


class WaypointsVerifyRequest(ProcedureRequest):
    """Compare the NaviCtrl's list with a mission: `do/waypoints_verify`. Writes nothing."""

    points: tuple[MissionPoint, ...] = Field(strict=False, min_length=1, max_length=254)
    """What to compare with."""


class WaypointsComparison(Telemetry):
    """Differences of the NaviCtrl's list: the answer to `do/waypoints_verify`."""

    digest: str
    """SHA-256 of the list asked about, in hexadecimal."""
    differences: tuple[str, ...]
    """Each in words; empty where the lists are equal."""

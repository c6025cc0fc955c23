"""Missions to and from the NaviCtrl."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mkdaemon.client.procedures import OnProgress, Procedures

if TYPE_CHECKING:
    from mkdaemon.telemetry.mission import Mission, RouteStarted, WaypointList, WaypointsComparison, WaypointsStored


class WaypointProcedures(Procedures):
    """Asks for procedures with the NaviCtrl's list of waypoints."""

    async def upload_waypoints(
        self,
        mission: Mission,
        *,
        source: str = "",
        in_flight: bool = False,
        allow_unusual: bool = False,
        on_progress: OnProgress | None = None,
    ) -> WaypointsStored:
        """Replace the list by a mission, read it back and compare every byte.

        Args:
            mission: what to fly.
            source: where it came from, for the event.
            in_flight: allow it with running motors: it takes effect at once.
            allow_unusual: take points more than 5 km away, below the start or more than 500 m above it.
            on_progress: called with every step.

        Raises:
            CommandRejectedError: refused, or not verified: do not fly this list then.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.mission import WaypointsStored

        fields = {"points": _points_of(mission), "source": source, "in_flight": in_flight}
        if allow_unusual:
            fields["allow_unusual"] = True
        return await self.run_procedure("waypoints_upload", WaypointsStored, fields, on_progress=on_progress)

    async def waypoints(self, *, on_progress: OnProgress | None = None) -> WaypointList:
        """Read the list.

        Args:
            on_progress: called with every step.

        Raises:
            CommandRejectedError: the NaviCtrl cannot be reached, did not answer, or its list is changing.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.mission import WaypointList

        return await self.run_procedure("waypoints_read", WaypointList, on_progress=on_progress)

    async def verify_waypoints(self, mission: Mission, *, on_progress: OnProgress | None = None) -> WaypointsComparison:
        """Compare the list with a mission; writes nothing.

        Args:
            mission: what the list should be.
            on_progress: called with every step.

        Raises:
            CommandRejectedError: as `waypoints`.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.mission import WaypointsComparison

        fields = {"points": _points_of(mission)}
        return await self.run_procedure("waypoints_verify", WaypointsComparison, fields, on_progress=on_progress)

    async def clear_waypoints(self, *, in_flight: bool = False) -> WaypointsStored:
        """Empty the list and see that it is empty.

        Args:
            in_flight: allow it with running motors: it ends a running route at once.

        Raises:
            CommandRejectedError: refused, or the list is not empty.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.mission import WaypointsStored

        return await self.run_procedure("waypoints_clear", WaypointsStored, {"in_flight": in_flight})

    async def start_route(self) -> RouteStarted:
        """Make the list ready to be flown by the pilot's GPS switch; in flight. Returns what the switch does then.

        Raises:
            CommandRejectedError: `route_on_ground`, `route_active`, `no_route`, or as `waypoints`.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.mission import RouteStarted

        return await self.run_procedure("route_start", RouteStarted, {"confirm": True})

    async def end_route(self) -> WaypointsStored:
        """Empty the list, in flight too: with the GPS switch at coming home the aircraft flies home at once.

        Raises:
            CommandRejectedError: refused, or the list is not empty.
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.mission import WaypointsStored

        return await self.run_procedure("route_end", WaypointsStored, {"confirm": True})


def _points_of(mission: Mission) -> list[dict[str, Any]]:
    return [point.model_dump(mode="json") for point in mission.points]

"""The NaviCtrl's own modes: a target, a route, the way home. The daemon prepares, the pilot's GPS switch flies."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from mkdaemon.client.samples import Sample
from mkdaemon.client.verbcalls import NaviVerbs, RouteVerbs, WaypointsVerbs
from mkdaemon.errors import CommandRejectedError, ManoeuvreError
from mkdaemon.telemetry.refusals import Token

if TYPE_CHECKING:
    from mkdaemon.telemetry.mission import Mission
    from mkdaemon.telemetry.navi import ControlNavi

NAVI: Final = "control/navi"
"""Key of what the NaviCtrl flies by itself."""
PATIENCE: Final = 300.0
"""Longest time for the pilot to turn the switch and for the way [s]."""
OnStage = Callable[["ControlNavi"], None]
"""Hears of every report of the NaviCtrl's flight."""


class Navi(NaviVerbs):
    """What the NaviCtrl flies by itself, followed to its end."""

    async def goto(
        self,
        east: float,
        north: float,
        up: float,
        *,
        heading_deg: int | None = None,
        radius: int = 3,
        hold: int = 255,
        patience: float = PATIENCE,
        on_stage: OnStage | None = None,
    ) -> ControlNavi:
        """Fly to a place by the NaviCtrl; in flight, when the pilot turns the GPS switch to coming home.

        Args:
            east: of home [m].
            north: of home [m].
            up: above the start [m]; flown only with height control, else by the pilot's throttle.
            heading_deg: compass heading to turn to [deg]; None keeps the heading.
            radius: the place counts as reached within it [m].
            hold: time to stay there [s]; then a NaviCtrl 0.24 flies home.
            patience: longest time until the place is reached [s].
            on_stage: called with every report.

        Returns:
            The report that says that it is there.

        Raises:
            CommandRejectedError: `route_on_ground`, `switch_at_home`, `position_poor`, `point_unusual`, or as
                `uav.waypoints.upload`.
            ManoeuvreError: not reached in time, landed, or the list is gone; says where it stood.
            MkError: no daemon serves this vehicle.
        """
        async with self._transport.watch(NAVI) as samples:
            await self.target((east, north, up), confirm=True, heading_deg=heading_deg, radius=radius, hold=hold)
            return await _follow(samples, lambda now: now.is_route_done, patience, on_stage, needs_list=True)

    async def route(
        self,
        mission: Mission | None = None,
        *,
        source: str = "",
        patience: float = PATIENCE,
        on_stage: OnStage | None = None,
    ) -> ControlNavi:
        """Fly a route by the NaviCtrl; in flight, when the pilot turns the GPS switch to coming home.

        Args:
            mission: uploaded first; None flies the list that the NaviCtrl holds.
            source: where the mission came from, for the event.
            patience: longest time until the last point is reached [s].
            on_stage: called with every report.

        Returns:
            The report that says that the last point is reached.

        Raises:
            CommandRejectedError: `route_on_ground`, `no_route`, or as `uav.waypoints.upload`.
            ManoeuvreError: as `goto`.
            MkError: no daemon serves this vehicle.
        """
        async with self._transport.watch(NAVI) as samples:
            if mission is not None:
                await WaypointsVerbs(self._transport).upload(mission.points, source=source, in_flight=True)
            try:
                await RouteVerbs(self._transport).start(confirm=True)
            except CommandRejectedError as refusal:
                if refusal.token != Token.ROUTE_ACTIVE:  # an upload in flight has made it ready
                    raise
            return await _follow(samples, lambda now: now.is_route_done, patience, on_stage, needs_list=True)

    async def home(self, *, patience: float = PATIENCE, on_stage: OnStage | None = None) -> ControlNavi:
        """Empty the list, and follow the way home, which the pilot's GPS switch at coming home begins.

        Args:
            patience: longest time until it is there [s].
            on_stage: called with every report.

        Returns:
            The report that says that it is home.

        Raises:
            CommandRejectedError: as `uav.route.end`.
            ManoeuvreError: not there in time, or landed on the way.
            MkError: no daemon serves this vehicle.
        """
        async with self._transport.watch(NAVI) as samples:
            await RouteVerbs(self._transport).end(confirm=True)
            return await _follow(samples, lambda now: now.is_home, patience, on_stage)


async def _follow(
    samples: AsyncIterator[Sample],
    is_done: Callable[[ControlNavi], bool],
    patience: float,
    on_stage: OnStage | None,
    *,
    needs_list: bool = False,
) -> ControlNavi:
    """Follow the NaviCtrl's flight to its end.

    Raises:
        ManoeuvreError: it did not come in time, cannot come any more, or the aircraft landed.
    """
    newest: ControlNavi | None = None
    had_list = False
    with suppress(TimeoutError):
        async with asyncio.timeout(patience):
            async for sample in samples:
                newest = sample.value
                if on_stage is not None:
                    on_stage(newest)
                if is_done(newest):
                    return newest
                if newest.stage is newest.stage.GROUND:
                    raise ManoeuvreError("the aircraft stands on the ground")
                had_list = had_list or bool(newest.waypoint)
                if needs_list and had_list and not newest.waypoint:
                    raise ManoeuvreError("the NaviCtrl's list is gone or not active any more: upload it again")
    shown = (
        "no report of the NaviCtrl's flight" if newest is None else f"{newest.stage.value}; the pilot {newest.hands}"
    )
    raise ManoeuvreError(f"not there within {patience:g} s: {shown}")

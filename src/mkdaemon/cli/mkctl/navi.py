"""What the NaviCtrl flies by itself when the pilot turns the GPS switch to coming home: a place, a list, home."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import Length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.waypoints import notify
from mkdaemon.errors import ConfigError
from mkdaemon.missions import read_mission

if TYPE_CHECKING:
    from mkdaemon.telemetry.navi import ControlNavi

PATIENCE = 300.0
"""For the pilot to turn the switch, and for the way [s]."""
Confirm = Annotated[
    bool, Parameter(help="I know that the NaviCtrl flies the aircraft when the pilot turns the switch.")
]
Patience = Annotated[Length, Parameter(name=["--patience"], help="Longest time for the switch and the flight [s].")]


async def status(*, connection: Connection = HERE) -> None:
    """Say what the NaviCtrl flies by itself, and what the pilot's hands do.

    Example: mkctl waypoints status

    Raises:
        MkError: no daemon.
    """
    async with connection.open() as uav:
        found = await uav.control.navi.latest()
    if found is None:
        connection.show({"stage": None}, "no report of a NaviCtrl yet")
    else:
        connection.show(_fields(found.value), stage_line(found.value))


async def fly(
    file: Annotated[Path | None, Parameter(help="Mission to upload first; default: the NaviCtrl's list.")] = None,
    /,
    *,
    confirm: Confirm = False,
    patience: Patience = PATIENCE,
    start_elevation: Annotated[float | None, Parameter(help="Elevation of the starting place [m].")] = None,
    altitude: Annotated[float | None, Parameter(help="Put every point at this height above the start [m].")] = None,
    connection: Connection = HERE,
) -> None:
    """Fly a route by the NaviCtrl; exit code 0 when its last point is reached.

    In flight, GPS switch at free or hold; then the pilot turns it to coming home.

    Example: mkctl waypoints fly survey.plan --confirm

    Raises:
        ConfigError: the file or a number cannot be, or `--confirm` is missing.
        MkError: the daemon refused, or the end was not reached; says why and where it stood.
    """
    _require(confirm=confirm)
    mission = (
        None if file is None else read_mission(file, start_elevation=start_elevation, altitude=altitude, notify=notify)
    )
    async with connection.open() as uav:
        source = "" if file is None else str(file)
        end = await uav.navi.route(mission, source=source, patience=patience, on_stage=StagePrinter().show)
    connection.show(_fields(end), f"the last of {end.waypoints} points is reached; the pilot {end.hands}")


async def home(*, confirm: Confirm = False, patience: Patience = PATIENCE, connection: Connection = HERE) -> None:
    """Empty the NaviCtrl's list and follow the way home; exit code 0 when it is there.

    The pilot turns the GPS switch to coming home; where it stands there already the aircraft flies home at once.

    Example: mkctl waypoints home --confirm

    Raises:
        ConfigError: a number cannot be, or `--confirm` is missing.
        MkError: the daemon refused, or it did not come home; says why and where it stood.
    """
    _require(confirm=confirm)
    async with connection.open() as uav:
        end = await uav.navi.home(patience=patience, on_stage=StagePrinter().show)
    connection.show(_fields(end), f"home; the pilot {end.hands}")


async def fly_to(
    position: tuple[float, float, float],
    heading: int | None,
    hold: int,
    *,
    confirm: bool,
    patience: float,
    connection: Connection,
) -> None:
    """Fly to a place at home; see `mkctl goto`.

    Raises:
        ConfigError: a number cannot be, or `--confirm` is missing.
        MkError: the daemon refused, or the place was not reached.
    """
    east, north, up = position
    _require(confirm=confirm)
    async with connection.open() as uav:
        end = await uav.navi.goto(
            east, north, up, heading_deg=heading, hold=hold, patience=patience, on_stage=StagePrinter().show
        )
    connection.show(_fields(end), f"reached; the pilot {end.hands}")


class StagePrinter:
    """Prints every stage once, on standard error."""

    def __init__(self) -> None:
        self._last = ""

    def show(self, report: ControlNavi) -> None:
        """Take a report."""
        if report.hands != self._last:
            print(stage_line(report), file=sys.stderr, flush=True)
        self._last = report.hands


def stage_line(report: ControlNavi) -> str:
    """A report in one line."""
    words = [report.stage.value.replace("_", " ")]
    if report.waypoints:
        words.append(f"waypoint {report.waypoint} of {report.waypoints}")
    if report.target_distance is not None:
        words.append(f"{report.target_distance:.0f} m to go")
    if report.home_distance is not None:
        words.append(f"{report.home_distance:.0f} m from home")
    return f"{', '.join(words)}: the pilot {report.hands}"


def _require(*, confirm: bool) -> None:
    if not confirm:
        msg = (
            "--confirm is missing: the aircraft flies by itself once the pilot turns the GPS switch to coming home; "
            "repeat with --confirm"
        )
        raise ConfigError(msg)


def _fields(report: ControlNavi) -> dict[str, object]:
    fields = report.model_dump(mode="json")
    del fields["stamp"]
    return fields

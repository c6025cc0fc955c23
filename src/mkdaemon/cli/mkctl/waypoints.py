"""`mkctl waypoints`: missions to and from the NaviCtrl, and between file formats."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.progress import showing_progress
from mkdaemon.errors import MkError
from mkdaemon.missions import check_place, read_mission, write_mission
from mkdaemon.telemetry.mission import Mission

app = App(
    name="waypoints",
    help="Missions of the NaviCtrl: files (GPX, KML, KMZ, .plan, CSV, .wpl, .waypoints), its list, and flying it.",
)
for _name in ("fly", "home", "status"):
    app.command(f"mkdaemon.cli.mkctl.navi:{_name}", name=_name)
for _name in ("start", "end"):
    app.command(f"mkdaemon.cli.mkctl.verbforms:route_{_name}", name=_name)

MissionFile = Annotated[Path, Parameter(help="Mission file; its suffix selects the format.")]
Elevation = Annotated[float | None, Parameter(help="Elevation of the starting place, for heights above sea level [m].")]
Height = Annotated[float | None, Parameter(help="Put every point at this height above the start [m].")]
InFlight = Annotated[bool, Parameter(help="Allow it while motors run: a changed list takes effect at once.")]
Unusual = Annotated[bool, Parameter(help="Take points over 5 km away, below the start or over 500 m above it.")]
Force = Annotated[bool, Parameter(help="Overwrite an existing file.")]


@app.command
async def upload(
    file: MissionFile,
    /,
    *,
    in_flight: InFlight = False,
    allow_unusual: Unusual = False,
    start_elevation: Elevation = None,
    altitude: Height = None,
    connection: Connection = HERE,
) -> None:
    """Replace the NaviCtrl's list by a mission, read it back and compare every byte.

    Example: mkctl waypoints upload survey.plan --altitude 10
    """
    mission = read_mission(file, start_elevation=start_elevation, altitude=altitude, notify=notify)
    async with connection.open() as uav, showing_progress(uav, "upload", quiet=connection.json) as report:
        done = await uav.waypoints.upload(
            mission.points, source=str(file), in_flight=in_flight, allow_unusual=allow_unusual, on_progress=report
        )
    text = f"{done.count} points stored and read back, content {done.digest[:16]}"
    connection.show({"count": done.count, "digest": done.digest, "rounds": done.rounds, "writes": done.writes}, text)


@app.command
async def read(file: MissionFile, /, *, force: Force = False, connection: Connection = HERE) -> None:
    """Read the NaviCtrl's list into a file.

    Example: mkctl waypoints read aboard.toml

    Raises:
        ConfigError: the file is there already.
        MkError: the list is empty or could not be read, or the file cannot be written.
    """
    check_place(file, overwrite=force)
    async with connection.open() as uav, showing_progress(uav, "read", quiet=connection.json) as report:
        found = await uav.waypoints.read(on_progress=report)
    if not found.points:
        raise MkError("the NaviCtrl holds no points; nothing was written")
    _warn(file, write_mission(Mission(points=found.points), file, overwrite=force))
    text = f"{len(found.points)} points written to {file}, content {found.digest[:16]}"
    connection.show({"count": len(found.points), "digest": found.digest, "file": str(file)}, text)


@app.command
async def verify(
    file: MissionFile,
    /,
    *,
    start_elevation: Elevation = None,
    altitude: Height = None,
    connection: Connection = HERE,
) -> int:
    """Compare the NaviCtrl's list with a mission; changes nothing. Exit code 1 where they differ.

    Example: mkctl waypoints verify survey.plan --altitude 10
    """
    mission = read_mission(file, start_elevation=start_elevation, altitude=altitude, notify=notify)
    async with connection.open() as uav, showing_progress(uav, "verify", quiet=connection.json) as report:
        found = await uav.waypoints.verify(mission.points, on_progress=report)
    text = "\n".join(found.differences)
    if not found.differences:
        text = f"the NaviCtrl holds this mission: {len(mission.points)} points, content {found.digest[:16]}"
    connection.show({"same": not found.differences, "digest": found.digest, "differences": found.differences}, text)
    return 1 if found.differences else 0


@app.command
async def clear(*, in_flight: InFlight = False, connection: Connection = HERE) -> None:
    """Empty the NaviCtrl's list and see that it is empty.

    Example: mkctl waypoints clear
    """
    async with connection.open() as uav:
        await uav.waypoints.clear(in_flight=in_flight)
    connection.show({"count": 0}, "the list is empty")


@app.command
def convert(
    source: MissionFile,
    target: MissionFile,
    /,
    *,
    start_elevation: Elevation = None,
    altitude: Height = None,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Convert a mission file to another format; needs no aircraft. What the format cannot keep is named.

    Example: mkctl waypoints convert survey.plan survey.toml
    """
    mission = read_mission(source, start_elevation=start_elevation, altitude=altitude, notify=notify)
    lost = write_mission(mission, target, overwrite=force)
    _warn(target, lost)
    count = len(mission.points)
    connection.show({"count": count, "file": str(target), "lost": lost}, f"{count} points written to {target}")


def notify(note: str) -> None:
    """Say on standard error what a mission leaves out of its file."""
    print(f"mkctl: {note}", file=sys.stderr)


def _warn(file: Path, lost: tuple[str, ...]) -> None:
    if lost:
        print(f"mkctl: {file}: this format does not keep {'; '.join(lost)}", file=sys.stderr)

"""`mkctl waypoints`: missions to and from the NaviCtrl, and between file formats."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Final, TypeVar

from cyclopts import App, Parameter

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.conversation import Report, converse, progress_bar
from mkdaemon.cli.mkctl.flightstate import require_motors_off
from mkdaemon.client import Vehicle
from mkdaemon.clock import Clock
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.missions import read_mission, write_mission
from mkdaemon.protocol.procedures.points import PointFormat, from_points, read_format, to_points
from mkdaemon.protocol.procedures.steps import Patience, Procedure
from mkdaemon.protocol.procedures.waypoints import (
    Difference,
    clear_points,
    content_hash,
    download_points,
    upload_points,
    verify_points,
)
from mkdaemon.telemetry.mission import Mission, MissionEvent
from mkdaemon.telemetry.refusals import Token, refuse

app = App(
    name="waypoints",
    help="Missions: GPX, KML, QGroundControl .plan, CSV and MikroKopter-Tool .wpl, told apart by the file's suffix.",
)

_Result = TypeVar("_Result")

PATIENCE: Final = Patience(attempts=6)

MissionFile = Annotated[Path, Parameter(help="Mission file; its suffix tells the format.")]
Elevation = Annotated[float | None, Parameter(help="Elevation of the starting place, for heights above sea level [m].")]
Height = Annotated[float | None, Parameter(help="Put every point at this height above the start [m].")]
InFlight = Annotated[
    bool, Parameter(negative=(), help="Allow it with running motors: a changed list takes effect at once.")
]


@app.command
async def upload(
    file: MissionFile,
    /,
    *,
    in_flight: InFlight = False,
    start_elevation: Elevation = None,
    altitude: Height = None,
    connection: Connection = HERE,
) -> None:
    """Replace the NaviCtrl's list by a mission, read it back and compare every byte."""
    mission = read_mission(file, start_elevation=start_elevation, altitude=altitude)
    async with connection.open() as client:
        points = to_points(mission, await converse(client, read_format(PATIENCE)))
        if not in_flight:
            await require_motors_off(client, "an upload takes effect at once", "--in-flight")
        with progress_bar("upload", quiet=connection.json) as report:
            done = await _guarded(client, upload_points(points, PATIENCE), in_flight, report)
        _publish(client, "uploaded", done.count, done.digest, str(file))
    text = f"{done.count} points stored and read back, content {done.digest[:16]}"
    _say(connection, text, count=done.count, digest=done.digest, rounds=done.rounds, writes=done.writes)


@app.command
async def download(file: MissionFile, /, *, connection: Connection = HERE) -> None:
    """Read the NaviCtrl's list into a file.

    Raises:
        MkError: the list is empty or could not be read.
    """
    async with connection.open() as client:
        with progress_bar("download", quiet=connection.json) as report:
            mission, digest = await converse(client, _download(), report)
    if not mission.points:
        msg = "the NaviCtrl holds no points; nothing was written"
        raise MkError(msg)
    _warn(file, write_mission(mission, file))
    text = f"{len(mission.points)} points written to {file}, content {digest[:16]}"
    _say(connection, text, count=len(mission.points), digest=digest, file=str(file))


@app.command
async def verify(
    file: MissionFile,
    /,
    *,
    start_elevation: Elevation = None,
    altitude: Height = None,
    connection: Connection = HERE,
) -> int:
    """Compare the NaviCtrl's list with a mission; changes nothing. Exit code 1 where they differ."""
    mission = read_mission(file, start_elevation=start_elevation, altitude=altitude)
    async with connection.open() as client:
        with progress_bar("verify", quiet=connection.json) as report:
            found, digest = await converse(client, _verify(mission), report)
    if found:
        text = "\n".join(str(difference) for difference in found)
    else:
        text = f"the NaviCtrl holds this mission: {len(mission.points)} points, content {digest[:16]}"
    _say(connection, text, same=not found, digest=digest, differences=[str(difference) for difference in found])
    return 1 if found else 0


@app.command
async def clear(*, in_flight: InFlight = False, connection: Connection = HERE) -> None:
    """Empty the NaviCtrl's list and see that it is empty."""
    async with connection.open() as client:
        form = await converse(client, read_format(PATIENCE))
        if not in_flight:
            await require_motors_off(client, "clearing ends a running route at once", "--in-flight")
        await _guarded(client, clear_points(form.kind, PATIENCE), in_flight)
        _publish(client, "cleared", 0, content_hash(()), "")
    _say(connection, "the list is empty", count=0)


@app.command
def convert(
    source: MissionFile,
    target: MissionFile,
    /,
    *,
    start_elevation: Elevation = None,
    altitude: Height = None,
    connection: Connection = HERE,
) -> None:
    """Convert a mission file to another format; needs no aircraft. What the format cannot keep is named."""
    mission = read_mission(source, start_elevation=start_elevation, altitude=altitude)
    lost = write_mission(mission, target)
    _warn(target, lost)
    count = len(mission.points)
    _say(connection, f"{count} points written to {target}", count=count, file=str(target), lost=lost)


async def _guarded(
    client: Vehicle, procedure: Procedure[_Result], in_flight: bool, report: Report | None = None
) -> _Result:
    """Without the flag, the daemon refuses every write from the moment on when motors run or nobody knows."""
    try:
        return await converse(client, procedure, report, confirm=in_flight)
    except CommandRejectedError as error:
        if error.token != Token.NOT_CONFIRMED:
            raise
        raise refuse(Token.MOTORS_STARTED, name="the upload") from error
    except MkError as error:
        msg = f"{error}; the board's list may be incomplete: repeat, or `mkctl waypoints clear`"
        raise MkError(msg) from error


def _download() -> Procedure[tuple[Mission, str]]:
    form: PointFormat = yield from read_format(PATIENCE)
    points = yield from download_points(form.kind, PATIENCE)
    return from_points(points, form), content_hash(points)


def _verify(mission: Mission) -> Procedure[tuple[tuple[Difference, ...], str]]:
    form = yield from read_format(PATIENCE)
    points = to_points(mission, form)
    return (yield from verify_points(points, PATIENCE)), content_hash(points)


def _publish(client: Vehicle, action: str, count: int, digest: str, source: str) -> None:
    event = MissionEvent(stamp=Clock().stamp(), action=action, count=count, digest=digest, source=source)
    client.stream("event/mission").put(encode(event), encoding=encoding_of(MissionEvent))


def _warn(file: Path, lost: tuple[str, ...]) -> None:
    if lost:
        print(f"mkctl: {file}: this format does not keep {'; '.join(lost)}", file=sys.stderr)


def _say(connection: Connection, text: str, **fields: object) -> None:
    print(json.dumps(fields) if connection.json else text)

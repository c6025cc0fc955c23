"""Mission Planner's list (`.waypoints`, "QGC WPL 110"): one mission item a line, read as ArduPilot reads it.

Line by line, between tabulators: number, current, frame, command, four parameters, latitude, longitude, altitude and
autocontinue. Item 0 is home, which is not flown. Source: MAVLink developer guide, "Plain-text file format"; Mission
Planner and MAVProxy write home first for every vehicle.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from mkdaemon.missions import qgc
from mkdaemon.missions.items import ARDUPILOT, FRAMES, WAYPOINT
from mkdaemon.missions.source import AltitudeReference, FilePlace, MissionDraft, require_few
from mkdaemon.telemetry.mission import Mission

HEAD: Final = "QGC WPL"
_CELLS: Final = 12
_PARAMS: Final = ("param1", "param2", "param3", "param4", "latitude", "longitude", "altitude")


def read(text: str, name: str) -> MissionDraft:
    """Read a list.

    Raises:
        ConfigError: it is another format or version, an item cannot be flown, or a value is wrong; names file, line
            and fix.
    """
    lines = text.lstrip("\ufeff").splitlines()
    head = lines[0].split() if lines else []
    if head != [*HEAD.split(), "110"]:
        raise FilePlace(name, 1).wrong("the first line is not 'QGC WPL 110'", "save the list again in Mission Planner")
    require_few(name, len(lines))
    rows = [(FilePlace(name, number), line.split()) for number, line in enumerate(lines[1:], 2) if line.split()]
    found = [(place, _item(place, cells)) for place, cells in rows]
    home = found[:1] if found and _is_home(found[0][1]) else []
    rest = found[len(home) :]
    if not rest:
        raise FilePlace(name, 1).wrong("no waypoint in this file", "save the list again with a waypoint beside home")
    draft = qgc.draft_of([item for _, item in rest], [place for place, _ in rest], ARDUPILOT)
    notes = tuple(f"{place}: home is not flown to" for place, _ in home)
    return replace(draft, notes=(*notes, *draft.notes), origins=tuple(one + len(home) for one in draft.origins))


def write(mission: Mission) -> str:
    """Return the mission as a list; its first point stands for home.

    Raises:
        ConfigError: a fail-safe point, which a list would fly to.
    """
    first = mission.points[0]
    rows: list[list[Any]] = [
        [0, 1, 0, WAYPOINT, 0, 0, 0, 0, f"{first.latitude_deg:.7f}", f"{first.longitude_deg:.7f}", 0, 1]
    ]
    for number, (item, _) in enumerate(qgc.items_of(mission), 1):
        params = [0 if value is None else value for value in item["params"]]
        place = [f"{value:.7f}" for value in params[4:6]]
        rows.append([number, 0, item["frame"], item["command"], *params[:4], *place, params[6], 1])
    return "\n".join([f"{HEAD} 110", *("\t".join(map(str, row)) for row in rows), ""])


def _is_home(item: dict[str, Any]) -> bool:
    return item["command"] == WAYPOINT and FRAMES.get(item["frame"]) is AltitudeReference.SEA_LEVEL


def _item(place: FilePlace, cells: list[str]) -> dict[str, Any]:
    if len(cells) != _CELLS:
        raise place.wrong(f"{len(cells)} cells in place of {_CELLS}", "save the list again in Mission Planner")
    return {
        "type": "SimpleItem",
        "frame": place.whole("frame", cells[2]),
        "command": place.whole("command", cells[3]),
        "params": [_param(place, word, cell) for word, cell in zip(_PARAMS, cells[4:11], strict=True)],
        "autoContinue": place.whole("autocontinue", cells[11]) != 0,
    }


def _param(place: FilePlace, word: str, cell: str) -> float | None:
    return None if cell.lower() == "nan" else place.number(word, cell)

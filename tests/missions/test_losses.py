"""What a format does not keep is named, and nothing else is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given

from mkdaemon.errors import ConfigError
from mkdaemon.missions import FORMATS, write_mission
from mkdaemon.missions.losses import lost
from mkdaemon.telemetry.mission import Mission, PointKind

from .missions import ROUND, missions

KEPT_BY_PLANS = {"latitude_deg", "longitude_deg", "altitude", "kind", "heading_deg", "poi", "speed", "photo_distance"}


def back(mission: Mission, suffix: str) -> Mission:
    form = FORMATS[suffix]
    return form.read(form.write(mission), "m" + suffix).mission


def fields_of(found: tuple[str, ...]) -> set[str]:
    return {entry.partition(" of ")[0] for entry in found if " of " in entry}


@given(mission=missions(max_size=4))
def test_a_plan_flies_the_same_and_names_the_rest(mission: Mission) -> None:
    """A speed of 0 after another one is the vehicle's own again, not the one before."""
    kinds = {point.kind for point in mission.points}
    looked_at = {point.poi for point in mission.points}
    nowhere = any(
        (point.latitude_deg, point.longitude_deg) == (0, 0) and (point.kind is not PointKind.POI or number in looked_at)
        for number, point in enumerate(mission.points, 1)
    )
    if kinds == {PointKind.POI} or PointKind.FAILSAFE in kinds or nowhere:
        with pytest.raises(ConfigError):
            back(mission, ".plan")
        return
    assert not fields_of(lost(mission, back(mission, ".plan"))) & KEPT_BY_PLANS


def test_what_is_lost_is_listed_with_its_points(tmp_path: Path) -> None:
    assert write_mission(ROUND, tmp_path / "round.csv") == ()
    assert write_mission(ROUND, tmp_path / "round.plan") == (
        "camera_angle_deg of point 2",
        "name of points 2 and 3",
        "event of point 2",
    )
    alone = Mission(points=(ROUND.points[0], ROUND.points[2], *ROUND.points[2:], ROUND.points[2]))
    assert write_mission(alone, tmp_path / "alone.plan")[-1] == "point 1, which no point looks at"
    assert write_mission(alone, tmp_path / "again.plan")[0] == "name of points 2, 3 and 4"

from __future__ import annotations

import pytest
from pydantic import ValidationError

from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

HERE = MissionPoint(latitude_deg=48.0, longitude_deg=11.5, altitude=520.0)


def test_a_point_has_one_heading() -> None:
    with pytest.raises(ValidationError, match="heading_deg and poi exclude each other"):
        MissionPoint(latitude_deg=1, longitude_deg=2, altitude=3, heading_deg=90, poi=1)


def test_a_point_looks_at_a_point_of_interest_of_its_own_mission() -> None:
    poi = HERE.model_copy(update={"kind": PointKind.POI})
    looking = HERE.model_copy(update={"poi": 1})
    assert Mission(points=(poi, looking)).points[1].poi == 1
    for points in ((HERE, looking), (poi, HERE.model_copy(update={"poi": 3}))):
        with pytest.raises(ValidationError, match="which is not a point of interest of this mission"):
            Mission(points=points)


def test_altitudes_are_raised_within_their_range() -> None:
    mission = Mission(points=(HERE,), name="Field")
    assert (mission.raised(-500.0).points[0].altitude, mission.raised(-500.0).name) == (20.0, "Field")
    with pytest.raises(ValidationError):
        mission.raised(6000.0)


@pytest.mark.parametrize(("field", "value"), [("latitude_deg", 90.1), ("altitude", float("nan")), ("name", "Größe")])
def test_values_have_limits(field: str, value: object) -> None:
    with pytest.raises(ValidationError):
        MissionPoint.model_validate(HERE.model_dump() | {field: value})

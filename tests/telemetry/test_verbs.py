"""The table of verbs, and the limits of a mission."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from mkdaemon.bus.keys import KEYS
from mkdaemon.daemon.procedures.table import PROCEDURES
from mkdaemon.telemetry import command
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind
from mkdaemon.telemetry.verbs import VERBS


def test_every_verb_is_a_key_and_no_other_key_is_one():
    assert [spec.suffix for spec in KEYS if spec.suffix.startswith("do/")] == [f"do/{verb.name}" for verb in VERBS]


def test_the_daemon_has_a_procedure_for_every_verb_that_is_one():
    by_hand = {"settings_recover"}  # looks at the journal, asks no board itself
    assert {verb.name for verb in VERBS if verb.is_procedure} - by_hand == set(PROCEDURES)


@pytest.mark.parametrize("request_of", [command.ReleaseRequest, command.AbortRequest])
def test_a_long_reason_is_cut_and_never_refused(request_of):
    assert request_of(reason="x" * 10_000).reason == "x" * 200
    assert request_of.model_validate_json('{"reason": "' + "y" * 201 + '"}').reason == "y" * 200


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

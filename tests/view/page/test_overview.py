"""A whole recording at a glance: parts that were flown, and marks, in seconds since its beginning."""

from __future__ import annotations

from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.play import PlayStatus
from mkdaemon.view.page.overview import overview_of
from mkdaemon.view.page.picture import PageReader, VehiclePicture
from tests import samples
from tests.view.page.test_picture import NOW, playing


def test_parts_follow_each_other_and_marks_have_their_place():
    free = {"phase": Phase.FREE, "lease": None, "manoeuvre": None}
    statuses = [
        samples.status(1000.0, **free),
        samples.status(1004.0, manoeuvre="takeoff"),
        samples.status(1005.0, manoeuvre="takeoff"),
        samples.status(1009.0, manoeuvre="hold"),
        samples.status(1020.0, **free),
    ]
    late, early = samples.refusal(1006.0), samples.refusal(1002.0)
    found = overview_of([*statuses, late, early, object()]).as_map(1000.0)
    assert [(part["begin"], part["text"]) for part in found["parts"]] == [
        (0.0, ""),
        (4.0, "takeoff"),
        (9.0, "hold"),
        (20.0, ""),
    ]
    assert [(mark["at"], mark["tone"]) for mark in found["marks"]] == [(2.0, "bad"), (6.0, "bad")]


def test_a_page_is_told_once():
    picture = VehiclePicture("mk1", is_played=True)
    picture.take_play(PlayStatus.model_validate(playing(0.0).model_dump() | {"zero": 1000.0}), NOW)
    picture.flight = overview_of([samples.status(1001.0, manoeuvre="hold")])
    reader = PageReader(picture)
    assert reader.read(NOW)["flight"]["parts"] == [{"begin": 1.0, "text": "hold"}]
    assert "flight" not in reader.read(NOW)

"""What a comparison says of a rendered flight is what the physics knows, within the noise of motion capture."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pytest

from lab.rigs.baselineflight import SOURCE, BaselineFlight
from mkdaemon.record.summary import summarise
from mkdaemon.view.report.alignment import PoseTrack
from mkdaemon.view.report.baseline import Baseline, compare
from mkdaemon.view.report.flight import FlightReader
from mkdaemon.view.report.make import report_of
from mksim.physics.mocap import ANGLE_SD, PLACE_SD

LENGTH: Final = 16.0
"""Of the flight [s]: hover at 1 m, sideways, then sideways and turned by 90 degrees."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    flight = BaselineFlight(3, LENGTH)
    assert flight.fly().lost == ""
    return flight.write(tmp_path_factory.mktemp("baseline") / "baseline.mcap"), flight.truth


def test_figures_against_motion_capture_are_those_against_the_truth(flown):
    path, truth = flown
    reader = FlightReader(has_sights=True)
    reader.count(summarise(path, taker_of=reader.taker))
    (flight,) = reader.flights.values()
    mine, theirs = flight.sights["down"], flight.sights[SOURCE]
    times, places, turns = (np.array(part) for part in zip(*truth, strict=True))
    view, images, camera = mine.sight("pad"), mine.images("pad"), mine.track("pad")
    found = compare(camera, theirs.track("pad"), view, images)
    true = compare(camera, PoseTrack(times, places, turns, np.zeros(len(times))), view, images)
    assert isinstance(found, Baseline)
    assert isinstance(true, Baseline)
    same = np.isin(true.raw.times, found.raw.times)
    assert same.sum() == len(found.raw.times) > 0.7 * len(camera.times)
    # Pose by pose: what motion capture adds is its own noise, less between two of its reports.
    assert np.std(found.raw.along - true.raw.along[same]) < PLACE_SD
    assert (np.std(found.raw.rpy - true.raw.rpy[same], axis=0) < math.degrees(ANGLE_SD)).all()
    for name, noise in (("along", PLACE_SD), ("across", PLACE_SD), ("turns", math.degrees(ANGLE_SD))):
        for kind in ("raw", "errors"):
            measured, real = (np.abs(getattr(getattr(one, kind), name)) for one in (found, true))
            # Nine of ten lengths of three normal errors are below 2.5 standard deviations.
            assert np.quantile(measured, 0.9) == pytest.approx(np.quantile(real[same], 0.9), abs=2.5 * noise)
    by_low = {one.low: one for one in true.distances}
    for one in found.distances:
        if one.scale is not None:
            assert one.scale == pytest.approx(by_low[one.low].scale, abs=PLACE_SD)
    for one, other in zip(found.offsets, true.offsets, strict=True):
        assert abs(one.value - other.value) < 4.0 * math.hypot(one.sd, other.sd), one.quantity.name
        assert not one.is_found, one.quantity.name


def test_the_recording_has_its_chapter(flown):
    (chapter,) = report_of(flown[0], None, against=SOURCE).chapters
    assert chapter.is_answered
    assert not any("no lens" in one for one in chapter.sentences)

"""What a comparison says of a rendered flight is what the physics knows, within the noise of motion capture."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pytest

from lab.control.flights import Flight
from lab.control.rendered import DOWN, RenderedRig
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.clock import Clock
from mkdaemon.config.positions import PositionSource
from mkdaemon.config.vision import VisionSection
from mkdaemon.control.regulator.autopilot import Goal
from mkdaemon.positions.positioneye import PositionEye
from mkdaemon.record.entry import Entry, EntryKind, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.summary import summarise
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.view.report.alignment import PoseTrack
from mkdaemon.view.report.baseline import Baseline, compare
from mkdaemon.view.report.flight import FlightReader
from mkdaemon.view.report.make import report_of
from mkdaemon.vision.pipeline import CameraPipeline
from mksim.physics.mocap import ANGLE_SD, PLACE_SD, RATE, MotionCapture

SOURCE: Final = "mocap"
PLACES: Final = (
    *((0.0, 0.0, 1.0, 0.0), (0.3, 0.0, 1.0, 0.0), (-0.2, 0.2, 1.0, 90.0), (0.0, 0.0, 2.0, 90.0)),
    *((1.0, 0.0, 2.0, 90.0), (-0.8, 0.7, 2.0, -90.0), (0.0, -0.8, 2.0, -90.0), (0.0, 0.0, 3.5, 0.0)),
    *((1.6, 0.0, 3.5, 0.0), (-1.4, 1.0, 3.5, 120.0), (0.0, -1.2, 3.0, 0.0), (0.0, 0.0, 1.5, 0.0)),
)
"""Flown one after the other, 4 s each: x, y, height [m], yaw [deg]; docs/lab/accuracy.md has the figures of all."""
LENGTH: Final = 16.0
"""Of the flight here [s]: hover at 1 m, sideways, then sideways and turned by 90 degrees."""
WALL: Final = 1.7e9
"""Unix time at which it begins [s]."""


def goal_at(t):
    place = PLACES[min(max(int((t - RenderedRig.handover) / 4.0), 0), len(PLACES) - 1)]
    return Goal(position=np.array(place[:3]), yaw=math.radians(place[3]))


class BaselineFlight(RenderedRig):
    """A flight over a tag by rendered images, seen by motion capture as well, recorded as the daemon records both.

    Attributes:
        truth: time [s], position of the vehicle [m], target from FLU (3, 3), at every measurement of the system.
    """

    def __init__(self, seed, seconds):
        super().__init__(Flight(seed=seed, seconds=seconds, start=0.6, goal=goal_at))
        self.now = 0.0
        self.clock = Clock(monotonic=lambda: self.now, wall=lambda: WALL + self.now, suspended=lambda: 0.0)
        self.base = TimeBase.of(self.clock.stamp(0.0))
        self._pipeline = CameraPipeline(DOWN, VisionSection(), self.clock)
        self.capture = MotionCapture(seed)
        self.eye = PositionEye(PositionSource(name=SOURCE, target="pad"))
        self.counts, self.entries, self.truth = {}, [], []
        self.keep([("vision/down/setup", self._pipeline.setup(self.clock.stamp(0.0)))], 0.0)
        self._at(0.005, self.measure)

    def keep(self, values, now):
        """Record values that are published at a time [s]."""
        for suffix, value in values:
            count = self.counts[suffix] = self.counts.get(suffix, 0) + 1
            coded = (f"mk/mk1/{suffix}", encode(value), encoding_of(type(value)))
            self.entries.append(Entry(EntryKind.SAMPLE, *coded, now, WALL + now, self.base, count))

    def write(self, path):
        """Write the recording."""
        session = Session("blackbox", "baseline", 0, "lab", "lab", self.base.boot, self.base.offset_ns, "mk1", "")
        with path.open("wb") as file:
            writer = RecordingWriter(file, session)
            for entry in sorted(self.entries, key=lambda one: one.received):
                writer.add(entry)
            writer.finish()
        return path

    def measure(self, at):
        """Measure at the rate of the system."""
        self._at(at + 1.0 / RATE, self.measure)
        truth = self._world.truth
        self.truth.append((at, truth.position_enu, truth.enu_from_flu))
        measured = self.capture.measure(at, truth)
        if measured is not None:
            report = measured.report(1, len(self.truth))
            self._at(at + measured.latency, lambda now: self.take(report, now))

    def take(self, report, now):
        self.keep(self.eye.take(report, now, now, self.clock.stamp(now), is_flown=self.core.is_in_air), now)

    def _watch(self, at):
        self.now = at
        super()._watch(at)

    def _publish(self, values, now):
        self.keep(values, now)
        super()._publish(values, now)

    def _hear(self, pitch, roll, yaw, at):
        self.eye.attitude_received(at, pitch, roll)
        super()._hear(pitch, roll, yaw, at)


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

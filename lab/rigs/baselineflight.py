"""A flight over a tag, seen by a camera and by motion capture, recorded as the daemon records both, in virtual time.

The flight core flies by rendered images: at several heights, sideways, turned. A simulated motion capture system
measures the truth meanwhile, and the truth itself is kept: `mkctl log report --against` is compared with it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from lab.control.flights import Flight
from lab.control.rendered import CAMERA, TARGET, RenderedRig
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.positions import PositionSource
from mkdaemon.config.vision import VisionSection
from mkdaemon.control.regulator.autopilot import Goal
from mkdaemon.frames import Matrix, Vector
from mkdaemon.positions.positioneye import PositionEye
from mkdaemon.record.entry import Entry, EntryKind, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.track.attitude import AttitudeHistory
from mksim.physics.mocap import RATE, Measured, MotionCapture

VEHICLE: Final = "mk1"
SOURCE: Final = "mocap"
PLACES: Final = (
    *((0.0, 0.0, 1.0, 0.0), (0.3, 0.0, 1.0, 0.0), (-0.2, 0.2, 1.0, 90.0), (0.0, 0.0, 2.0, 90.0)),
    *((1.0, 0.0, 2.0, 90.0), (-0.8, 0.7, 2.0, -90.0), (0.0, -0.8, 2.0, -90.0), (0.0, 0.0, 3.5, 0.0)),
    *((1.6, 0.0, 3.5, 0.0), (-1.4, 1.0, 3.5, 120.0), (0.0, -1.2, 3.0, 0.0), (0.0, 0.0, 1.5, 0.0)),
)
"""Flown one after the other: x, y, height [m], yaw [deg]."""
STAY: Final = 4.0
"""Between two of them [s]."""
LENGTH: Final = RenderedRig.handover + STAY * len(PLACES)
"""Of the flight [s]."""


class TapedPipeline(CameraPipeline):
    """The product's eyes; what they publish is recorded."""

    def __init__(self, flight: BaselineFlight, clock: Clock) -> None:
        camera = CameraSection(name="down", source="zenoh:lab", calibration=CAMERA, targets=(TARGET,), jpeg_hz=0.0)
        super().__init__(camera, VisionSection(), clock)
        self._flight = flight

    def process(self, image: CameraImage, attitude: AttitudeHistory | None) -> list[tuple[str, Telemetry]]:
        """Look at an image."""
        values = super().process(image, attitude)
        self._flight.keep(values, image.received_at)
        return values


class BaselineFlight(RenderedRig):
    """One flight.

    Attributes:
        truth: time [s], position of the vehicle [m], target from FLU (3, 3), at every measurement of the system.
    """

    def __init__(self, seed: int, seconds: float = LENGTH, **source: Any) -> None:
        """Prepare.

        Args:
            seed: of everything random.
            seconds: length; all of `PLACES` by default.
            source: keys of the section of the source.
        """
        super().__init__(Flight(seed=seed, seconds=seconds, start=0.6, goal=_goal_at))
        self._now = 0.0
        clock = Clock(monotonic=lambda: self._now, wall=lambda: 1.7e9 + self._now, suspended=lambda: 0.0)
        self._clock, self._base = clock, TimeBase.of(clock.stamp(0.0))
        self._pipeline = TapedPipeline(self, clock)
        self._capture = MotionCapture(seed)
        self._eye = PositionEye(PositionSource(**{"name": SOURCE, "target": "pad"} | source))
        self._counts: dict[str, int] = {}
        self._reports = 0
        self.entries: list[Entry] = []
        self.truth: list[tuple[float, Vector, Matrix]] = []
        self.keep([("vision/down/setup", self._pipeline.setup(clock.stamp(0.0)))], 0.0)
        self._at(0.005, self._measure)

    def keep(self, values: list[tuple[str, Telemetry]], now: float) -> None:
        """Record values that are published at a time [s]."""
        for suffix, value in values:
            count = self._counts[suffix] = self._counts.get(suffix, 0) + 1
            key, wall = f"mk/{VEHICLE}/{suffix}", 1.7e9 + now
            self.entries.append(
                Entry(EntryKind.SAMPLE, key, encode(value), encoding_of(type(value)), now, wall, self._base, count)
            )

    def write(self, path: Path) -> Path:
        """Write the recording."""
        session = Session("blackbox", "baseline", 0, "lab", "lab", self._base.boot, self._base.offset_ns, VEHICLE, "")
        with path.open("wb") as file:
            writer = RecordingWriter(file, session)
            for entry in sorted(self.entries, key=lambda one: one.received):
                writer.add(entry)
            writer.finish()
        return path

    def _watch(self, at: float) -> None:
        self._now = at
        super()._watch(at)

    def _measure(self, at: float) -> None:
        """Measure at the rate of the system."""
        self._at(at + 1.0 / RATE, self._measure)
        truth = self._world.truth
        self.truth.append((at, truth.position_enu, truth.enu_from_flu))
        measured = self._capture.measure(at, truth)
        if measured is not None:
            self._reports += 1
            self._at(at + measured.latency, self._arrived(measured, self._reports))

    def _arrived(self, measured: Measured, sequence: int) -> Any:
        report = measured.report(1, sequence)

        def take(now: float) -> None:
            self.keep(self._eye.take(report, now, now, self._clock.stamp(now), is_flown=self.core.is_in_air), now)

        return take

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        self._eye.attitude_received(at, pitch, roll)
        super()._hear(pitch, roll, yaw, at)


def _goal_at(t: float) -> Goal:
    place = PLACES[min(max(int((t - RenderedRig.handover) / STAY), 0), len(PLACES) - 1)]
    return Goal(position=np.array(place[:3]), yaw=math.radians(place[3]))

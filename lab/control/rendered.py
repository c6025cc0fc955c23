"""The same flights with rendered images: scene, tracker and pose as in the product, in virtual time."""

from __future__ import annotations

from typing import Final

from lab.control.corerig import CoreRig
from lab.control.flights import Flight
from lab.places import ROOT
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.control.events import PoseSeen
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.vision import VisionPose
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mksim.config import SceneConfig
from mksim.scene.camera import BodyState, SceneCamera

CAMERA: Final = ROOT / "configs" / "cameras" / "sim.toml"
TARGET: Final = ROOT / "configs" / "targets" / "nested.toml"
DOWN: Final = CameraSection(name="down", source="zenoh:lab", calibration=CAMERA, targets=(TARGET,), jpeg_hz=0.0)
EXPOSURE_MS: Final = 6.0
HISTORY: Final = 200
"""Attitude samples the eyes keep."""


class RenderedRig(CoreRig):
    """A flight decided by the flight core from rendered images; the target lies still.

    Attributes:
        images: exposed so far.
        posed: of those, with a pose.
    """

    handover = 6.0

    def __init__(self, flight: Flight) -> None:
        super().__init__(flight)
        scene = SceneConfig(enabled=True, camera=CAMERA, targets=(TARGET,), ground="tiles", exposure_ms=EXPOSURE_MS)
        self._scene = SceneCamera(scene, flight.seed)
        self._pipeline = CameraPipeline(DOWN, VisionSection(), Clock())
        self._attitudes: list[AttitudeSample] = []
        self.images = self.posed = 0

    def _expose(self, at: float) -> None:
        eyes = self._flight.camera
        self._at(at + 1 / eyes.rate, self._expose)
        truth = self._world.truth
        state = BodyState(at, truth.position_enu, truth.velocity_enu, truth.enu_from_flu, truth.rates)
        pixels = self._scene.expose(state)
        self.images += 1
        number = self.images
        delay = max(0.01, eyes.latency + self._rng.gauss(0, eyes.jitter))

        seen = eyes.look(at, truth.enu_from_flu, self._place(at), self._rng)

        def look(now: float) -> None:
            if seen is not None:
                self._show_pilot(seen, now)
            image = CameraImage(pixels, at, now, number, "down", "header")
            self._publish(self._pipeline.process(image, AttitudeHistory(tuple(self._attitudes))), now)

        self._at(at + delay, look)

    def _publish(self, values: list[tuple[str, Telemetry]], now: float) -> None:
        for _, value in values:
            if isinstance(value, VisionPose):
                self.posed += 1
                self.core.feed(PoseSeen(value), now)

    def _hear(self, pitch: float, roll: float, yaw: float, at: float) -> None:
        super()._hear(pitch, roll, yaw, at)
        self._attitudes.append(AttitudeSample(at, roll, pitch, yaw))
        del self._attitudes[:-HISTORY]

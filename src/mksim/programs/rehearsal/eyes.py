"""Rendered images through the real tracker, in virtual time: exposed, rendered, looked at after their latency."""

from __future__ import annotations

import asyncio
import random
from collections import deque
from contextlib import suppress
from typing import Final

from mkdaemon.clock import Clock
from mkdaemon.config.vision import VisionSection
from mkdaemon.control.events import Feed, PoseSeen
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.errors import MkError
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import VisionPose
from mkdaemon.vision.camera.calibration_file import mount_rotation
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.output import values_of
from mkdaemon.vision.tags.nested import nested_map
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, Mounting
from mkdaemon.vision.track.tracker import Tracker
from mksim.physics.world import World
from mksim.programs.rehearsal.scenery import EYES_TIME, IMAGE_LATENCY
from mksim.scene.camera import BodyState, Grey, SceneCamera

KEPT: Final = 200
"""Attitudes kept for late images."""
JITTER: Final = 0.005
"""Standard deviation of the latency [s]."""


class RehearsedEyes(Eyes):
    """The camera of the simulated aircraft and what looks through it.

    Attributes:
        images: looked at so far.
        posed: of those, with a pose.
    """

    def __init__(self, scene: SceneCamera, world: World, feed: Feed, clock: Clock, seed: int) -> None:
        super().__init__(None)
        self.images = self.posed = 0
        self._scene, self._world, self._feed, self._clock = scene, world, feed, clock
        self._rng = random.Random(f"{seed} latency")
        self._attitudes: deque[AttitudeSample] = deque(maxlen=KEPT)
        mount = scene.camera.mount
        self._mounting = Mounting(mount_rotation(mount), scene.arm_flu)
        vision = VisionSection()
        self._tracker = Tracker(
            nested_map(),
            scene.camera.intrinsics,
            self._mounting,
            vision.tracker,
            vision.detector,
        )

    def attitude_received(self, attitude: Attitude) -> None:
        """Tell the eyes how the vehicle lies."""
        at = attitude.stamp.monotonic
        self._attitudes.append(AttitudeSample(at, attitude.roll, attitude.pitch, attitude.yaw))

    async def run(self) -> None:
        """Expose for ever."""
        loop = asyncio.get_running_loop()
        period, due = 1.0 / self._scene.cfg.fps, loop.time()
        while True:
            truth, at = self._world.truth, self._clock.now()
            state = BodyState(at, truth.position_enu, truth.velocity_enu, truth.enu_from_flu, truth.rates)
            pixels = self._scene.expose(state)
            latency = IMAGE_LATENCY + EYES_TIME + abs(self._rng.gauss(0.0, JITTER))
            loop.call_later(latency, self._look, pixels, at)
            due += period
            await asyncio.sleep(due - loop.time())

    def _look(self, pixels: Grey, exposed: float) -> None:
        self.images += 1
        now = self._clock.now()
        image = CameraImage(pixels, exposed, now, self.images, "down", "header")
        with suppress(MkError):
            result = self._tracker.update(image, AttitudeHistory(tuple(self._attitudes)))
            for _, value in values_of(result, image, self._clock.stamp(exposed), self._mounting, now):
                if isinstance(value, VisionPose):
                    self.posed += 1
                    self._feed(PoseSeen(value), now)

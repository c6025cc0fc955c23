"""The cameras of a replay: recorded images through today's eyes, or the recorded poses where images are missing."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import msgpack

from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.core import FlightCore
from mkdaemon.daemon.audit import Outlet
from mkdaemon.daemon.eyes import Eyes, PoseSink
from mkdaemon.record.entry import Entry
from mkdaemon.replay.timing import ReplayLoop
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import VisionPose

if TYPE_CHECKING:
    from mkdaemon.vision.pipeline import CameraPipeline
    from mkdaemon.vision.track.attitude import AttitudeSample

USUAL: Final = 0.02
"""Time from an image to what is seen in it, where nothing was seen when it was recorded [s]."""
ATTITUDES: Final = 200
"""Attitudes kept for late images; as many as `mkdaemon.vision.worker` keeps."""


class BlindEyes(Eyes):
    """No camera, or one whose images were not recorded: the recorded poses reach the flight core."""

    def __init__(self, core: FlightCore) -> None:
        super().__init__(None)
        self._core = core

    def bring_pose(self, entry: Entry) -> None:
        """Hand a recorded pose to the flight core."""
        self._core.pose_received(VisionPose.model_validate(msgpack.unpackb(entry.payload)))


class ReplayedEyes(Eyes):
    """Looks at every recorded image, at the time it was looked at, and tells at the time it was told."""

    def __init__(
        self,
        cfg: Config,
        outlet: Outlet,
        core: FlightCore,
        clock: Clock,
        loop: ReplayLoop,
        published_at: Mapping[tuple[str, int], float],
    ) -> None:
        """Set the cameras up.

        Args:
            cfg: cameras and tracker.
            outlet: where values go, after the flight core.
            core: hears of poses.
            clock: stamps.
            loop: of the replay.
            published_at: by camera and number of the image: when something seen in it was published [s].

        Raises:
            ConfigError: a camera file or target file is wrong or not here.
        """
        from mkdaemon.vision.pipeline import CameraPipeline

        super().__init__(None)
        self._sink = PoseSink(core, outlet)
        self._clock, self._loop, self._published_at = clock, loop, published_at
        self._attitudes: deque[AttitudeSample] = deque(maxlen=ATTITUDES)
        self._pipelines: dict[str, CameraPipeline] = {
            camera.name: CameraPipeline(camera, cfg.vision, clock) for camera in cfg.cameras
        }

    def attitude_received(self, attitude: Attitude) -> None:
        """Tell the eyes how the vehicle lies."""
        from mkdaemon.vision.track.attitude import AttitudeSample

        self._attitudes.append(AttitudeSample(attitude.stamp.monotonic, attitude.roll, attitude.pitch, attitude.yaw))

    def bring_image(self, entry: Entry) -> None:
        """Look at an image."""
        from mkdaemon.vision.camera.image import CameraImage
        from mkdaemon.vision.camera.imagecodec import unpack
        from mkdaemon.vision.camera.shot import PictureError
        from mkdaemon.vision.track.attitude import AttitudeHistory

        try:
            frame, pixels = unpack(entry.payload)
        except PictureError:
            return  # nor was it looked at in flight
        pipeline = self._pipelines.get(frame.camera)
        if pipeline is None:
            return
        stamped_by = entry.issuer or "arrival"
        image = CameraImage(pixels, frame.stamp.monotonic, entry.received, frame.sequence, frame.camera, stamped_by)
        values = pipeline.process(image, AttitudeHistory(tuple(self._attitudes)))
        published_at = self._published_at.get((frame.camera, frame.sequence), entry.received + USUAL)
        for suffix, value in values:
            self._loop.happens_at(max(published_at, self._loop.time()), self._sink.publish, suffix, value)

    def bring_mount(self, camera: str) -> None:
        """Publish how a camera sits, as it is published beside its figures."""
        pipeline = self._pipelines.get(camera)
        mount = None if pipeline is None else pipeline.mount(self._clock.stamp())
        if mount is not None:
            self._sink.publish("tf", mount)

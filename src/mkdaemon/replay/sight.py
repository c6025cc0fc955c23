"""The cameras of a replay: recorded images through today's eyes, or the recorded poses where images are missing."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.core import FlightCore
from mkdaemon.daemon.audit import Outlet
from mkdaemon.daemon.eyes import Eyes, PoseSink
from mkdaemon.record.entry import Entry, Kind
from mkdaemon.record.notices import Notice
from mkdaemon.replay.recorded import Recorded, fields_of, value_of
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import Transform, VisionPose, VisionStats

if TYPE_CHECKING:
    from mkdaemon.vision.camera.image import CameraImage
    from mkdaemon.vision.pipeline import CameraPipeline
    from mkdaemon.vision.track.attitude import AttitudeSample

ATTITUDES: Final = 200
"""Attitudes kept for late images; as many as `mkdaemon.vision.worker` keeps."""


class BlindEyes(Eyes):
    """No camera, or one whose images were not recorded: the recorded poses reach the flight core."""

    def __init__(self, core: FlightCore, outlet: Outlet, clock: Clock) -> None:
        super().__init__(None)
        self._sink = PoseSink(core, outlet, clock)

    def bring_seen(self, entry: Entry) -> None:
        """Hand on what was seen, and what a camera said of itself."""
        match entry.suffix.rpartition("/")[2]:
            case "pose":
                self._sink.publish(entry.suffix, value_of(entry, VisionPose))
            case "stats":
                self._sink.publish(entry.suffix, value_of(entry, VisionStats))


class ReplayedEyes(Eyes):
    """Looks at every recorded image, and tells what it sees where it was told."""

    def __init__(self, cfg: Config, outlet: Outlet, core: FlightCore, clock: Clock, recorded: Recorded) -> None:
        """Set the cameras up.

        Args:
            cfg: cameras and tracker.
            outlet: where values go, after the flight core.
            core: hears of poses.
            clock: stamps.
            recorded: has the images.

        Raises:
            ConfigError: a camera file or target file is wrong or not here.
        """
        from mkdaemon.vision.pipeline import CameraPipeline

        super().__init__(None)
        self._sink, self._clock = PoseSink(core, outlet, clock), clock
        self._attitudes: deque[AttitudeSample] = deque(maxlen=ATTITUDES)
        self._known_until = {
            (seen["camera"], seen["sequence"]): seen["attitude"]
            for seen in (fields_of(moment.entry) for moment in recorded.notices(Notice.IMAGE_SEEN))
        }
        self._pipelines: dict[str, CameraPipeline] = {
            camera.name: CameraPipeline(camera, cfg.vision, clock) for camera in cfg.cameras
        }
        self._images: dict[str, deque[tuple[int, Entry]]] = {name: deque() for name in self._pipelines}
        for moment in recorded.of(Kind.IMAGE):
            frame = fields_of(moment.entry)
            if frame["camera"] in self._images:
                self._images[frame["camera"]].append((frame["sequence"], moment.entry))

    def attitude_received(self, attitude: Attitude) -> None:
        """Tell the eyes how the vehicle lies."""
        from mkdaemon.vision.track.attitude import AttitudeSample

        self._attitudes.append(AttitudeSample(attitude.stamp.monotonic, attitude.roll, attitude.pitch, attitude.yaw))

    def bring_seen(self, entry: Entry) -> None:
        """Look at every image up to the one something was seen in then; pass on what a camera said of itself."""
        if entry.suffix == "tf":
            self._publish_mount(value_of(entry, Transform))
            return
        _, camera, what = entry.suffix.split("/", 2)
        if what == "stats":
            self._sink.publish(entry.suffix, value_of(entry, VisionStats))
            return
        images, fields = self._images.get(camera, deque()), fields_of(entry)
        while images and what != "image" and images[0][0] <= fields["sequence"]:
            image = _image(images.popleft()[1])
            if image is not None:
                self._look(image)

    def _look(self, image: CameraImage) -> None:
        """Look at an image with the attitudes that were known then."""
        from mkdaemon.vision.track.attitude import AttitudeHistory

        until = self._known_until.get((image.camera, image.sequence))
        known = AttitudeHistory(sample for sample in self._attitudes if until is not None and sample.time <= until)
        for suffix, value in self._pipelines[image.camera].process(image, known):
            self._sink.publish(suffix, value)

    def _publish_mount(self, recorded: Transform) -> None:
        """Publish how a camera sits where that was published; what is seen in an image comes with the image."""
        from mkdaemon.vision.output import camera_frame

        for name, pipeline in self._pipelines.items():
            mount = pipeline.mount(recorded.stamp) if recorded.child == camera_frame(name) else None
            if mount is not None:
                self._sink.publish("tf", mount)


def _image(entry: Entry) -> CameraImage | None:
    """An image as it came from the camera; None where it cannot be read."""
    from mkdaemon.vision.camera.image import CameraImage
    from mkdaemon.vision.camera.imagecodec import unpack
    from mkdaemon.vision.camera.shot import PictureError

    try:
        frame, pixels = unpack(entry.payload)
    except PictureError:
        return None
    by = entry.issuer or "arrival"
    return CameraImage(pixels, frame.stamp.monotonic, entry.received, frame.sequence, frame.camera, by)

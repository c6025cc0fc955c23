"""Recorded images through today's eyes."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.record.entry import Entry, EntryKind, Notice
from mkdaemon.replay.recorded import Recorded, fields_of, value_of
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import Transform

if TYPE_CHECKING:
    from mkdaemon.vision.camera.image import CameraImage

ATTITUDES: Final = 200
"""Attitudes that are known of an image; as many as `mkdaemon.vision.worker` keeps."""

LATE: Final = 0.1
"""Time after an image at which something new in it would have been published [s]."""


def has_every_image(recorded: Recorded, cfg: Config) -> bool:
    """Whether every image that was looked at is in the recording: a tracker follows from image to image."""
    looked = {
        entry.suffix: fields_of(entry)["processed"]
        for entry in recorded.of(EntryKind.SAMPLE)
        if entry.suffix.startswith("vision/") and entry.suffix.endswith("/stats")
    }
    is_whole = bool(cfg.cameras) and not cfg.positions  # what sources of poses report is not recorded as it came
    return is_whole and len(recorded.of(EntryKind.IMAGE)) >= max(sum(looked.values()), 1)


def look_again(recorded: Recorded, cfg: Config, clock: Clock) -> Iterator[tuple[float, str, Telemetry]]:
    """Look at every image with the attitudes that were known then.

    Yields when something was seen in that image then [s], keys and values, in order of each camera.

    Args:
        recorded: has the images.
        cfg: cameras and tracker.
        clock: stamps.

    Raises:
        ConfigError: a camera file or target file is wrong or not here.
        MkError: a recorded value is not of the form it has today.
    """
    from mkdaemon.vision.pipeline import CameraPipeline, camera_frame
    from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample

    samples = [entry for entry in recorded.of(EntryKind.SAMPLE) if entry.suffix in {"state/attitude", "tf"}]
    values = [value_of(entry, Attitude) for entry in samples if entry.suffix == "state/attitude"]
    attitudes = [AttitudeSample(value.stamp.monotonic, value.roll, value.pitch, value.yaw) for value in values]
    times = [sample.time for sample in attitudes]
    known_until = {
        (seen["camera"], seen["sequence"]): seen["attitude"]
        for seen in map(fields_of, recorded.notices(Notice.IMAGE_SEEN))
    }
    seen_at = {
        (entry.suffix.split("/")[1], fields_of(entry).get("sequence")): entry.received
        for entry in recorded.of(EntryKind.SAMPLE)
        if entry.suffix.startswith("vision/") and not entry.suffix.endswith(("/stats", "/image"))
    }
    pipelines = {camera.name: CameraPipeline(camera, cfg.vision, clock) for camera in cfg.cameras}
    for image in filter(None, map(_image, recorded.of(EntryKind.IMAGE))):
        until = known_until.get((image.camera, image.sequence))
        known = 0 if until is None else bisect_right(times, until)
        history = AttitudeHistory(attitudes[max(known - ATTITUDES, 0) : known])
        at = seen_at.get((image.camera, image.sequence), image.received_at + LATE)
        for suffix, value in pipelines[image.camera].process(image, history):
            yield at, suffix, value
    mounts = {camera_frame(name): pipeline for name, pipeline in pipelines.items()}
    for edge in (value_of(entry, Transform) for entry in samples if entry.suffix == "tf"):
        mount = mounts[edge.child].mount(edge.stamp) if edge.child in mounts else None
        if mount is not None:
            yield edge.stamp.monotonic, "tf", mount


def _image(entry: Entry) -> CameraImage | None:
    """An image as it came from the camera; None where it cannot be read."""
    from mkdaemon.vision.camera.image import CameraImage, PictureError
    from mkdaemon.vision.camera.imagecodec import unpack

    try:
        frame, pixels = unpack(entry.payload)
    except PictureError:
        return None
    by = entry.issuer or "arrival"
    return CameraImage(pixels, frame.stamp.monotonic, entry.received, frame.sequence, frame.camera, by)

"""What a camera of a vehicle sees and how well: its newest values in one place, and what to change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mkdaemon.errors import MkError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from mkdaemon.client.samples import Sample
    from mkdaemon.client.vehicle import Vehicle
    from mkdaemon.telemetry.vision import Tags, VisionStats

    Grey = npt.NDArray[np.uint8]

SLOW: Final = 10.0
"""Fewer images a second are worth a word [Hz]."""
LATE: Final = 200.0
"""Images that are later make the aircraft overshoot [ms]; above 500 the check before a flight refuses."""
DROPPED: Final = 0.3
"""Part of the images that a newer one replaced, from which the detector is what is slow [1]."""
LONG_EXPOSURE: Final = 15.0
"""A longer exposure smears three pixels where a vehicle shakes [ms]; docs/cameras.md."""
FLAT_LIGHT: Final = 40.0
"""Less between black and white cells is hard to read [grey]."""
SOFT: Final = 0.25
"""Edges that are softer begin to melt cells [cells]."""


class CameraLook:
    """The newest values of one camera.

    Attributes:
        name: of the camera.
        stats: how it works; None before the first.
        tags: of the newest image that was searched; None before the first.
        target: what is seen of a target, in words; empty for nothing.
        softness: of the edges of the largest tag, in its cells; None where no image shows one.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.stats: VisionStats | None = None
        self.tags: Tags | None = None
        self.target = ""
        self.softness: float | None = None
        self._pixels: Grey | None = None

    @property
    def keys(self) -> tuple[str, ...]:
        """What to watch."""
        return tuple(f"vision/{self.name}/{kind}" for kind in ("stats", "tags", "pose", "image"))

    @property
    def pixels(self) -> Grey | None:
        """The newest image `(h, w)` uint8; None where none was published."""
        return self._pixels

    def take(self, sample: Sample) -> None:
        """Note a value.

        Raises:
            ProtocolError: it is none that this version knows.
        """
        match sample.suffix.rpartition("/")[2]:
            case "stats":
                self.stats = sample.value
            case "tags":
                self.tags = sample.value
            case "pose":
                x, y, z = sample.value.position_target
                self.target = f"{sample.value.target} x {x:+.2f} y {y:+.2f} z {z:.2f} m"
            case "image":
                self._take_image(sample.fields)

    def outlines(self) -> list[tuple[str, npt.NDArray[np.float64]]]:
        """Name and corners `(4, 2)` of every tag, in pixels of the published image; empty where there is none."""
        import numpy as np

        if self.tags is None or self._pixels is None or self.stats is None or not self.stats.width:
            return []
        scale = self._pixels.shape[1] / self.stats.width
        return [(str(tag.id), (np.array(tag.corners) + 0.5) * scale - 0.5) for tag in self.tags.tags]

    def write_picture(self, path: Path, *, overwrite: bool = False) -> None:
        """Write the newest image with its tags; nothing where none was published.

        Args:
            path: .png or .jpg.
            overwrite: replace a file that is there.

        Raises:
            ConfigError: it is there already, or of no format that can be written.
            MkError: it cannot be written.
        """
        from mkdaemon.vision.camera.imagecodec import write_picture
        from mkdaemon.vision.still import draw_tags

        if self._pixels is not None:
            write_picture(path, draw_tags(self._pixels, self.outlines()), overwrite=overwrite)

    def advice(self) -> list[str]:
        """What to change, each a sentence; empty where nothing has to be."""
        return list(advise(self.stats, self.softness)) if self.stats is not None else []

    def _take_image(self, fields: Mapping[str, Any]) -> None:
        import numpy as np

        from mkdaemon.telemetry.image import CameraFrame
        from mkdaemon.vision.calibrate.printcheck import softness
        from mkdaemon.vision.camera.image import PictureError
        from mkdaemon.vision.camera.imagecodec import decode_picture
        from mkdaemon.vision.tags.cellread import Detection

        frame = CameraFrame.model_validate(fields)
        try:
            if frame.coding == "gray8":
                self._pixels = np.frombuffer(frame.pixels, np.uint8).reshape(frame.height, frame.width)
            else:
                self._pixels = decode_picture(frame.pixels)
        except (PictureError, ValueError):
            return  # the next one may be whole
        outlines = self.outlines()
        if self.tags is not None and outlines:
            found = [
                Detection(tag.family, tag.id, 0, 0.0, corners)
                for tag, (_, corners) in zip(self.tags.tags, outlines, strict=True)
            ]
            self.softness = softness(self._pixels, max(found, key=lambda one: one.side_px))


async def find_camera(uav: Vehicle, name: str = "") -> str:
    """The camera of a name, or the only one.

    Raises:
        MkError: there is none, no such one, or several.
    """
    last = await uav.get_all("vision/*/stats")
    known = sorted(key.split("/")[1] for key, stats in last.items() if stats.fields.get("trusted_for") is None)
    if name in known:
        return name
    if not known:
        raise MkError(await uav.absence() or f"vehicle {uav.vehicle} has no camera: configure one, docs/cameras.md")
    if name:
        raise MkError(f"vehicle {uav.vehicle} has no camera {name!r}; there is {', '.join(known)}")
    if len(known) > 1:
        raise MkError(f"which camera? There is {', '.join(known)}")
    return known[0]


def advise(stats: VisionStats, soft: float | None = None) -> Iterator[str]:
    """What to change about a camera, each a sentence.

    Args:
        stats: its figures.
        soft: how soft the edges of a tag are, in its cells; None where it is not known.
    """
    if stats.reason:
        yield f"{stats.state}: {stats.reason}"
    yield from stats.alarms.values()
    if stats.settings_refused:
        yield f"the driver refused {', '.join(stats.settings_refused)}: set it with v4l2-ctl, or leave it unset"
    if 0 < stats.fps < SLOW:
        yield f"only {stats.fps:.0f} images a second: a smaller image, Motion JPEG, or more light"
    if stats.latency_p50_ms > LATE:
        yield f"images are {stats.latency_p50_ms:.0f} ms old: smaller image, cable instead of radio, or fewer programs"
    seen = stats.processed + stats.dropped
    if stats.dropped > DROPPED * max(seen, 1):
        yield f"the detector is too slow ({stats.detect_p50_ms:.0f} ms an image): a smaller image, or fewer images"
    yield from _light(stats)
    if soft is not None and soft > SOFT:
        yield f"edges are soft ({soft:.2f} of a cell): focus, clean the lens, or a shorter exposure"


def _light(stats: VisionStats) -> Iterator[str]:
    exposure = stats.exposure
    if exposure is None:
        return
    if exposure.exposure_ms > LONG_EXPOSURE:
        yield f"{exposure.exposure_ms:.1f} ms of exposure smear in flight: more light, or more gain"
    if exposure.black is not None and exposure.white is not None and exposure.white - exposure.black < FLAT_LIGHT:
        yield "black and white hardly differ: more light, no glare on the print"


def tag_words(tags: Sequence[Any]) -> str:
    """Tags in words, with the length of their sides."""
    import numpy as np

    words = []
    for tag in tags:
        corners = np.array(tag.corners)
        side = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())
        words.append(f"{tag.id} ({side:.0f} px)")
    return ", ".join(words) or "none"

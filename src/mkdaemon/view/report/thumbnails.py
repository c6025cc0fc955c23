"""Small pictures of what a camera saw when something happened."""

from __future__ import annotations

import base64
from bisect import bisect_right
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from mkdaemon.client.pictures import small_jpeg
from mkdaemon.reading import EventLine
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.reader import Recording
from mkdaemon.view.report.flight import ImagePlace, RecordedFlight

BEFORE: Final = 2.0
"""An image that is older than this when something happens does not show it [s]."""
AFTER: Final = 1.0
"""If there is no image before the event, one within this time after it is used [s]."""
WIDTH: Final = 300
"""Of a picture [px]; shown at half of that."""
MOST: Final = 60
"""Pictures of a page."""
Place = tuple[EntryKind, str, int]


def choose(flight: RecordedFlight, happenings: Sequence[EventLine]) -> dict[int, ImagePlace]:
    """Which image shows what happened, by the happening's place in the list; each image only once, the first time.

    Args:
        flight: with its images.
        happenings: of it, in order.
    """
    images = sorted(flight.images, key=lambda image: image.at)
    times = [image.at for image in images]
    chosen: dict[int, ImagePlace] = {}
    used: set[Place] = set()
    for place, happening in enumerate(happenings):
        index = bisect_right(times, happening.at)
        before = images[index - 1] if index and happening.at - times[index - 1] <= BEFORE else None
        after = images[index] if index < len(images) and times[index] - happening.at <= AFTER else None
        image = before or after
        if image is not None and _place(image) not in used and len(chosen) < MOST:
            used.add(_place(image))
            chosen[place] = image
    return chosen


def read(path: Path, chosen: dict[int, ImagePlace], progress: Callable[[int], None]) -> dict[int, str]:
    """Pictures as data URIs, by the place of their happening; what is damaged has none.

    Args:
        path: the recording.
        chosen: which images, by the place of their happening.
        progress: hears how many bytes of the file have been read.

    Raises:
        ConfigError: OpenCV is not installed.
        MkError: the file cannot be opened.
    """
    wanted = {_place(image): place for place, image in chosen.items()}
    keys = {(kind, key) for kind, key, _ in wanted}
    recording, found = Recording(path), dict[int, str]()
    for entry in recording.entries(lambda facts: (facts.kind, facts.key) in keys) if keys else ():
        progress(recording.position)
        place = wanted.pop((entry.kind, entry.key, entry.sequence), None)
        picture = None if place is None else small_jpeg(entry.payload, WIDTH)
        if place is not None and picture is not None:
            found[place] = f"data:image/jpeg;base64,{base64.b64encode(picture).decode()}"
        if not wanted:
            break
    return found


def _place(image: ImagePlace) -> Place:
    return image.kind, image.key, image.sequence

"""`mkdaemon calibrate map`: where the tags of a room are, by images of them."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import progress_bars
from mkdaemon.cli.printing import show
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.files import refuse_existing, save
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.reader import Recording
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.calibration_file import Intrinsics, load_camera
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import read_picture, unpack
from mkdaemon.vision.camera.sources import CLIPS, list_pictures, open_clip
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.survey.picture import picture_of
from mkdaemon.vision.survey.survey import KnownTags, Survey, Surveyed, look_at, survey
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Place, Target, single
from mkdaemon.vision.tags.targetfile import FORMATS, Form, as_toml

Decode = Callable[[], Grey]
_SIZES: Final = re.compile(r"([0-9]{1,5})(?:-([0-9]{1,5}))?=([0-9.]+)")
_PLACE: Final = re.compile(r"([a-z0-9][a-z0-9_-]*)=([0-9]{1,5})")
_DISTANCE: Final = re.compile(r"([0-9]{1,5}):([0-9]{1,5})=([0-9.]+)")


@dataclass(frozen=True, slots=True)
class _Images:
    """Images of the sources: how many, and how each is decoded."""

    count: int
    each: Callable[[], Iterator[Decode]]


def survey_map(
    sources: Annotated[list[Path], Parameter(help="Recordings with images, videos, pictures, or folders of them.")],
    /,
    *,
    camera: Annotated[Path, Parameter(help="Camera file of mkdaemon calibrate camera.")],
    size: Annotated[float, Parameter(help="Side of the black square of the tags [m].")],
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="File to write.")] = Path("map.toml"),
    sizes: Annotated[tuple[str, ...], Parameter(help="Tags of another size: ID=SIZE or FIRST-LAST=SIZE [m].")] = (),
    family: Annotated[str, Parameter(help="Family of the tags.")] = "tag36h11",
    origin: Annotated[int | None, Parameter(help="Tag in the origin; by default the one seen most often.")] = None,
    distance: Annotated[
        tuple[str, ...], Parameter(help="Measured between the middles of two tags: ID:ID=DISTANCE [m].")
    ] = (),
    name: Annotated[str, Parameter(help="Name of the target in the map.")] = "map",
    place: Annotated[
        tuple[str, ...], Parameter(help="A place to fly to and land on, in the middle of a tag: NAME=ID.")
    ] = (),
    form: Annotated[Form, Parameter(name="--format", help="Format of the file.")] = "toml",
    most: Annotated[int, Parameter(name="--images", help="Images that are looked at, evenly chosen.")] = 2000,
    picture: Annotated[Path | None, Parameter(help="Also draw the map into this SVG file.")] = None,
    force: Annotated[bool, Parameter(help="Overwrite existing files.")] = False,
    as_json: AsJson = False,
) -> int:
    """Find where tags are, and write a target file of all of them.

    Carry the camera slowly over the tags, or fly by hand: each tag in twenty images or more, always two or more tags
    at once, from different places and turned. The sides of the tags, or a measured distance, give the scale. A tag that
    was moved, has another size than was given, or exists twice is named and left out; the exit code is then 1.

    Example: mkdaemon calibrate map flight.mcap --camera camera.toml --size 0.16 -o map.toml

    Raises:
        ConfigError: a source, the camera file or an option cannot be used, or a file is there already.
        VisionError: too little is seen, or the origin or the end of a distance is not in the map.
        MkError: a recording cannot be read, or a file cannot be written.
    """
    for path in (output, picture):
        if path is not None:
            refuse_existing(path, overwrite=force)
    lens = load_camera(camera).intrinsics
    wanted, places = _wanted(size, sizes, family, origin, distance), _places(place)
    images = _images(sources, most)
    with progress_bars("{task.description}", "{task.percentage:3.0f} %", quiet=as_json) as bars:
        looking, adjusting = (bars.add_task(title, total=1.0) for title in ("looking at images", "adjusting"))
        found = []
        for tags in look_at(_pixels(images, lens), lens, family, os.cpu_count() or 1):
            found.append(tags)
            bars.update(looking, completed=len(found) / images.count)
        result = survey(found, wanted, Projection(lens), lambda share: bars.update(adjusting, completed=share))
    target, notes = _target(name, result, places), {one.tag.tag_id: _note(one) for one in result.tags}
    text = as_toml(target, _heading(result, sources), notes) if form == "toml" else FORMATS[form].write(target)
    save(output, text, overwrite=force)
    if picture is not None:
        save(picture, picture_of(result), overwrite=force)
    lacking = "\nthis format holds neither sizes nor family: give them to the program that reads it"
    words = _words(result, output) + (lacking if form == "wpilib" else "")
    show(_object(result, output), words, as_json=as_json)
    return 1 if result.left_out else 0


def _wanted(
    size: float, sizes: tuple[str, ...], family: str, origin: int | None, distances: tuple[str, ...]
) -> KnownTags:
    """What the options say of the tags; an error where one cannot be."""
    by_code: dict[int, float] = {}
    for text in sizes:
        match = _SIZES.fullmatch(text)
        if match is None:
            raise ConfigError(f"--sizes '{text}': give ID=SIZE or FIRST-LAST=SIZE in metres, for example 7=0.3")
        first, last, side = match.groups()
        by_code.update(dict.fromkeys(range(int(first), int(last or first) + 1), _number("--sizes", text, side)))
    try:
        for side in {size, *by_code.values()}:
            single(side, 0, family=find_family(family).name)
    except VisionError as error:
        raise ConfigError(str(error)) from None
    measured: dict[tuple[int, int], float] = {}
    for text in distances:
        between = _DISTANCE.fullmatch(text)
        if between is None or between[1] == between[2]:
            raise ConfigError(f"--distance '{text}': give ID:ID=DISTANCE in metres, for example 3:17=2.405")
        measured[int(between[1]), int(between[2])] = _number("--distance", text, between[3])
    return KnownTags(size, by_code, family, origin, measured)


def _places(texts: tuple[str, ...]) -> dict[str, int]:
    """The tags of named places."""
    found: dict[str, int] = {}
    for text in texts:
        match = _PLACE.fullmatch(text)
        if match is None or match[1] in found:
            raise ConfigError(f"--place '{text}': give NAME=ID, each name once, for example pad-b=17")
        found[match[1]] = int(match[2])
    return found


def _target(name: str, result: Survey, places: Mapping[str, int]) -> Target:
    """The surveyed tags, and places in the middle of some of them."""
    tags = {one.tag.tag_id: replace(one.tag, place_sd=one.place_sd, turn_sd=one.turn_sd) for one in result.tags}
    for called, code in places.items():
        if code not in tags:
            raise VisionError(f"--place {called}={code}: tag {code} is not in the map")
    named = tuple(Place.on(tags[code], called) for called, code in places.items())
    return Target(name, name, moving=False, level=True, tags=tuple(tags.values()), places=named)


def _number(option: str, text: str, number: str) -> float:
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    if value <= 0.0:
        raise ConfigError(f"{option} '{text}': '{number}' is no length in metres")
    return value


def _images(sources: list[Path], most: int) -> _Images:
    """The images of all sources, at most `most`, evenly chosen."""
    counts = [sum(1 for _ in _each(path)) for path in sources]
    count = sum(counts)
    if not count:
        raise ConfigError(
            f"no image in {', '.join(map(str, sources))}: a recording has images where record.images.hz is above 0"
        )
    chosen = {k * count // min(most, count) for k in range(min(most, count))}

    def each() -> Iterator[Decode]:
        number = 0
        for path in sources:
            for decode in _each(path):
                if number in chosen:
                    yield decode
                number += 1

    return _Images(len(chosen), each)


def _each(path: Path) -> Iterator[Decode]:
    """How to decode each image of a source."""
    if not path.exists():
        raise ConfigError(f"no such recording, video, picture or folder: {path}")
    try:
        if path.is_dir():
            yield from (partial(read_picture, each) for each in list_pictures(path))
        elif path.suffix.lower() == ".mcap":
            for entry in Recording(path).entries():
                if entry.kind is EntryKind.IMAGE:
                    yield partial(_of_payload, entry.payload)
        elif path.suffix.lower() in CLIPS:
            yield from (decode for _, decode in open_clip(path))
        else:
            yield partial(read_picture, path)
    except VisionError as error:
        raise ConfigError(str(error)) from None


def _of_payload(payload: bytes) -> Grey:
    return unpack(payload)[1]


def _pixels(images: _Images, lens: Intrinsics) -> Iterator[Grey]:
    """The images that can be decoded; one of another size than the lens's is an error."""
    for decode in images.each():
        try:
            pixels = decode()
        except PictureError:
            continue
        height, width = pixels.shape
        if (width, height) != (lens.width, lens.height):
            msg = f"the images are {width}x{height}, the calibration is for {lens.width}x{lens.height}"
            raise ConfigError(msg)
        yield pixels


def _note(one: Surveyed) -> str:
    place, turn = 1000.0 * np.linalg.norm(one.place_sd), np.degrees(np.linalg.norm(one.turn_sd))
    return f"known to {place:.1f} mm and {turn:.2f} deg by {one.images} images"


def _heading(result: Survey, sources: list[Path]) -> str:
    of = ", ".join(path.name for path in sources)
    lines = [f"Surveyed by {result.images} images of {of}; corners fit to {result.rms_px:.2f} px."]
    lines += [f"Left out: tag {one.tag_id}, {one.words}." for one in result.left_out]
    return "\n".join(lines)


def _words(result: Survey, output: Path) -> str:
    worst = max(result.tags, key=lambda one: float(np.linalg.norm(one.place_sd)))
    worst_mm = 1000.0 * float(np.linalg.norm(worst.place_sd))
    lines = [
        f"{len(result.tags)} tags in {output}, origin tag {result.tags[0].tag.tag_id}, by {result.images} images",
        f"corners fit to {result.rms_px:.2f} px; worst known: tag {worst.tag.tag_id}, {worst_mm:.1f} mm",
    ]
    if result.scale != 1.0:
        lines.append(f"stretched by {100.0 * (result.scale - 1.0):+.2f} % to the measured distances")
    lines += [f"left out: tag {one.tag_id} ({one.fault}): {one.words}" for one in result.left_out]
    lines += [f"weak: tag {code}, {words}" for code, words in result.weak]
    return "\n".join(lines)


def _object(result: Survey, output: Path) -> dict[str, Any]:
    return {
        "file": str(output),
        "images": result.images,
        "rms_px": round(result.rms_px, 4),
        "corner_sd_px": round(result.corner_sd, 4),
        "scale": round(result.scale, 6),
        "tags": [
            {
                "id": one.tag.tag_id,
                "position": [round(float(v), 5) for v in one.tag.position],
                "position_sd": [round(float(v), 6) for v in one.place_sd],
                "turn_sd": [round(float(v), 6) for v in one.turn_sd],
                "images": one.images,
                "rms_px": round(one.rms_px, 4),
            }
            for one in result.tags
        ],
        "left_out": [{"id": one.tag_id, "fault": one.fault, "words": one.words} for one in result.left_out],
        "weak": [{"id": code, "words": words} for code, words in result.weak],
    }

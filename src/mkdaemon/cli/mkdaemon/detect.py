"""`mkdaemon detect`: tags and their poses in pictures, folders and videos."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.calibration_file import Intrinsics, load_camera
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import read_picture, write_picture
from mkdaemon.vision.camera.sources import CLIPS, Recorded, list_pictures, open_clip
from mkdaemon.vision.pose.pose import with_floor
from mkdaemon.vision.still import StillEye, StillPose, StillResult, StillTag, draw
from mkdaemon.vision.stillhints import hints
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.tags.targetfile import load

_CODE: Final = r"[0-9]{1,5}"
"""Of a tag; the largest family has 48,714."""


@dataclass(frozen=True, slots=True)
class InputPicture:
    """One image of the input: its file, its number in a video, its pixels or why there are none."""

    file: str
    frame: int | None
    pixels: Grey | None
    error: str = ""


def detect(
    images: Annotated[list[Path], Parameter(help="Pictures, folders of pictures, or videos.")],
    /,
    *,
    camera: Annotated[Path | None, Parameter(help="Camera file of mkdaemon calibrate camera.")] = None,
    target: Annotated[tuple[Path, ...], Parameter(help="Target file; may be given again.")] = (),
    intrinsics: Annotated[
        str | None, Parameter(help="FX,FY,CX,CY[,K1,K2,P1,P2,K3] instead of a camera file.", allow_leading_hyphen=True)
    ] = None,
    tag_size: Annotated[float | None, Parameter(help="Side of the black square of single tags [m].")] = None,
    family: Annotated[tuple[str, ...], Parameter(help="Families of single tags.")] = ("tag36h11",),
    ids: Annotated[str | None, Parameter(help="Search only these codes, for example 0,3,7-9.")] = None,
    as_json: AsJson = False,
    overlay: Annotated[
        Path | None, Parameter(help="Write pictures with the results: a folder, or one file for one image.")
    ] = None,
    force: Annotated[bool, Parameter(help="Overwrite existing pictures.")] = False,
) -> int:
    """Find tags and their poses.

    Corners are in pixels whose centres are whole numbers, in the order top-left, top-right, bottom-right, bottom-left
    of the print. A pose is the target in the camera (x right, y down, z forward): translation [m], quaternion (w, x, y,
    z), their covariance, and the residual of the mirrored pose over this one as `ambiguity` (null where there is none).
    Without a calibration there are no poses. Exit code 1 when an image could not be read.

    Example: mkdaemon detect photo.jpg --camera camera.toml --target configs/targets/nested.toml

    Raises:
        ConfigError: options that exclude each other, a camera or target file that cannot be used, or a picture that
            is there already.
        MkError: a picture cannot be written.
    """
    if camera is not None and intrinsics is not None:
        raise ConfigError("give --camera or --intrinsics, not both")
    if target and (tag_size is not None or ids is not None):
        raise ConfigError(f"give --target or {'--tag-size' if tag_size is not None else '--ids'}, not both")
    figures = _intrinsics(intrinsics) if intrinsics is not None else None
    lens = load_camera(camera).intrinsics if camera is not None else None
    tagmap = load(target) if target else None
    eye = _eye(tagmap, tag_size, family, _ids(ids) if ids is not None else None)
    pictures, failed = list(_inputs(images)), 0
    for picture in _pictures(pictures, lens):
        if picture.pixels is None:
            failed += 1
            _print_picture(picture, None, None, as_json=as_json)
            continue
        height, width = picture.pixels.shape
        k = lens if figures is None else figures.model_copy(update={"width": width, "height": height})
        result = eye.look(picture.pixels, k)
        hinted = _hints(picture, result, eye, tagmap.whitelist if tagmap else family)
        _print_picture(picture, result, k, as_json=as_json, sized=bool(target) or tag_size is not None, hinted=hinted)
        if overlay is not None:
            path = _overlay_path(overlay, picture, single=len(pictures) == 1)
            write_picture(path, draw(picture.pixels, result, k), overwrite=force)
    return 1 if failed else 0


def _eye(
    tagmap: TagMap | None, tag_size: float | None, families: tuple[str, ...], ids: frozenset[int] | None
) -> StillEye:
    """What looks at the images; it says what is wrong with families, codes and size."""
    try:
        return StillEye(tagmap=tagmap, tag_size=tag_size, families=families, ids=ids)
    except VisionError as error:
        raise ConfigError(str(error)) from None


def _intrinsics(text: str) -> Intrinsics:
    """Read `FX,FY,CX,CY[,K1,K2,P1,P2,K3]`, which hold for any size of image."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    if not 4 <= len(numbers) <= len(names) or not np.isfinite(numbers).all() or min(numbers[:2]) <= 0:
        msg = f"intrinsics '{text}': give FX,FY,CX,CY[,K1,K2,P1,P2,K3] as finite numbers, focal lengths above zero"
        raise ConfigError(msg)
    return Intrinsics(width=1, height=1, **dict(zip(names, numbers, strict=False)))


def _ids(text: str) -> frozenset[int]:
    """Read `0,3,7-9`."""
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not all(re.fullmatch(_CODE, code) for code in ((first, last) if dash else (first,))):
            raise ConfigError(f"--ids '{text}': give codes and ranges below 100000, for example 0,3,7-9")
        if int(last or first) < int(first):
            raise ConfigError(f"--ids '{text}': {part.strip()} counts down; give codes and ranges, for example 0,3,7-9")
        found.update(range(int(first), int(last or first) + 1))
    return frozenset(found)


def _inputs(paths: list[Path]) -> Iterator[Path]:
    """Files behind the arguments; folders are listed."""
    for path in paths:
        if path.is_dir():
            try:
                yield from list_pictures(path)
            except VisionError as error:
                raise ConfigError(str(error)) from None
        elif path.exists():
            yield path
        else:
            raise ConfigError(f"no such picture, folder or video: {path}")


def _pictures(paths: list[Path], lens: Intrinsics | None) -> Iterator[InputPicture]:
    """All images of pictures and videos, and what is wrong with those that are none, or not of this lens."""
    for path in paths:
        is_clip, number = path.suffix.lower() in CLIPS, -1
        try:
            images: Iterable[Recorded] = open_clip(path) if is_clip else [(0.0, partial(read_picture, path))]
        except VisionError:
            yield InputPicture(str(path), None, None, "no video that can be read")
            continue
        for number, (_, decode) in enumerate(images):
            pixels, fault = None, ""
            try:
                pixels = _of_lens(decode(), lens)
            except PictureError as error:
                fault = str(error)
            yield InputPicture(str(path), number if is_clip else None, pixels, fault)
        if number < 0:
            yield InputPicture(str(path), None, None, "no image in this video")


def _of_lens(pixels: Grey, lens: Intrinsics | None) -> Grey:
    """An image, which is an error where it is of another size than a lens is known for."""
    height, width = pixels.shape
    if lens is not None and (lens.width, lens.height) != (width, height):
        raise PictureError(f"the picture is {width}x{height}, the calibration is for {lens.width}x{lens.height}")
    return pixels


def _print_picture(
    picture: InputPicture,
    result: StillResult | None,
    k: Intrinsics | None,
    *,
    as_json: bool,
    sized: bool = False,
    hinted: Sequence[str] = (),
) -> None:
    if as_json:
        print(json.dumps({**_object(picture, result), **({"hints": hinted} if hinted else {})}), flush=True)
        return
    file = on_one_line(picture.file)
    name = file if picture.frame is None else f"{file} [{picture.frame}]"
    if result is None:
        print(f"mkdaemon: {name}: {on_one_line(picture.error)}", file=sys.stderr)
        return
    print(f"{name}: {len(result.tags)} tags")
    for tag in result.tags:
        found = tag.found
        x, y = found.corners.mean(axis=0)
        print(f"  {found.family} {found.tag_id} at {x:.1f}, {y:.1f} px, hamming {found.hamming}")
    for pose in result.poses:
        x, y, z = pose.pose.position
        doubt = f", doubtful: {pose.refusal}" if pose.refusal is not None else ""
        tilt = f"tilt {np.degrees(pose.pose.tilt):.1f} deg{', ambiguous' if pose.ambiguous else ''}{doubt}"
        print(f"  {on_one_line(pose.target)}: right {x:.4f}, down {y:.4f}, ahead {z:.4f} m, {tilt}")
    if result.tags and not result.poses:
        print(f"  no pose: {_missing(k, sized=sized)}")
    for hint in hinted:
        print(f"  hint: {hint}")


def _hints(picture: InputPicture, result: StillResult, eye: StillEye, families: Iterable[str]) -> list[str]:
    """Hints about a picture, and about the first image of a video."""
    if picture.pixels is None or picture.frame:
        return []
    return list(hints(picture.pixels, result, eye, families))


def _missing(k: Intrinsics | None, *, sized: bool) -> str:
    """What stands between tags and a pose."""
    if k is None:
        return "give --camera or --intrinsics"
    return "nothing fits these tags" if sized else "give --target or --tag-size"


def _object(picture: InputPicture, result: StillResult | None) -> dict[str, Any]:
    """The JSON object of one image."""
    found: dict[str, Any] = {"file": picture.file}
    if picture.frame is not None:
        found["frame"] = picture.frame
    if picture.pixels is not None:
        found["width"], found["height"] = picture.pixels.shape[1], picture.pixels.shape[0]
    found["tags"] = [_tag(tag) for tag in result.tags] if result is not None else []
    poses = [_pose(pose) for pose in result.poses] if result is not None else []
    found["pose"] = poses[0] if poses else None
    found["poses"] = poses
    if picture.error:
        found["error"] = picture.error
    return found


def _tag(tag: StillTag) -> dict[str, Any]:
    found = tag.found
    fields: dict[str, Any] = {
        "family": found.family,
        "id": found.tag_id,
        "hamming": found.hamming,
        "decision_margin": round(found.decision_margin, 2),
        "corners": [[round(float(x), 4), round(float(y), 4)] for x, y in found.corners],
    }
    if tag.pose is not None:
        fields["pose"] = _pose(tag.pose)
    return fields


def _pose(found: StillPose) -> dict[str, Any]:
    pose = found.pose
    return {
        "target": found.target,
        "translation": [float(v) for v in pose.position],
        "quaternion": list(quaternion_from_rotation(pose.rotation)),
        "covariance": [[float(v) for v in row] for row in with_floor(pose)],
        "ambiguity": found.ambiguity if np.isfinite(found.ambiguity) else None,
        "ambiguous": found.ambiguous,
        "source": pose.source,
        "points": pose.points,
        "rms_px": pose.rms_px,
        "doubt": found.refusal or "",
    }


def _overlay_path(place: Path, picture: InputPicture, *, single: bool) -> Path:
    """The named picture when there is one image, else one in a folder under the image's own name."""
    if single and picture.frame is None and place.suffix.lower() in {".png", ".jpg", ".jpeg"}:
        return place
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"--overlay {place}: {error.strerror}; name a folder, or a .png or .jpg for one image"
        raise ConfigError(msg) from None
    number = "" if picture.frame is None else f"-{picture.frame:06d}"
    return place / f"{Path(picture.file).stem}{number}.png"

"""A print judged by one photograph: what `mkdaemon calibrate check-print` shows. Needs OpenCV, the extra `vision`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.foreignfiles import LONGEST_PICTURE, read_bytes

if TYPE_CHECKING:
    from mkdaemon.vision.calibrate.printcheck import PrintFinding


def check_photo(
    photo: Path, target: Path, camera: Path | None = None, distance: float | None = None
) -> tuple[PrintFinding, ...]:
    """Judge a print by one photograph.

    Args:
        photo: the picture.
        target: file of the target that was printed.
        camera: file of the calibrated camera; its size is the picture's.
        distance: from the lens to the middle of the largest tag, by tape [m].

    Raises:
        ConfigError: a file cannot be used, it holds several targets, or the picture is of another size than the camera.
        MkError: the picture cannot be read.
    """
    from mkdaemon.vision.calibrate.printcheck import check_print
    from mkdaemon.vision.camera.calibration_file import load_camera
    from mkdaemon.vision.camera.image import PictureError
    from mkdaemon.vision.camera.imagecodec import decode_picture
    from mkdaemon.vision.tags.targetfile import load

    targets = load([target]).targets
    if len(targets) > 1:
        raise ConfigError(f"target file {target} holds {len(targets)} targets: give the one that was printed")
    intrinsics = None if camera is None else load_camera(camera).intrinsics
    try:
        pixels = decode_picture(read_bytes(photo, LONGEST_PICTURE))
    except OSError as error:
        raise ConfigError(f"{photo}: {error.strerror or 'cannot be read'}") from None
    except PictureError as error:
        raise MkError(f"{photo}: {error}") from None
    height, width = pixels.shape
    if intrinsics is not None and (intrinsics.width, intrinsics.height) != (width, height):
        raise ConfigError(f"{photo} is {width}x{height}, the calibration is for {intrinsics.width}x{intrinsics.height}")
    return check_print(pixels, targets[0], intrinsics, distance)

"""What OpenCV captures, before OpenCV decodes it where it can be had.

OpenCV decodes motion JPEG in silence: damaged blocks stay in the image, and an image of another size than the first is
scaled to it. Its bytes are therefore taken as they come. Other codecs are left to OpenCV, which scales a stream that
changes its size: `sizewatch` sees that.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.imagecodec import decode_picture
from mkdaemon.vision.camera.shot import PictureError

Grey = npt.NDArray[np.uint8]

MOTION_JPEG: Final = frozenset(cv2.VideoWriter.fourcc(*name) for name in ("MJPG", "mjpg", "JPEG", "jpeg"))
UNDECODED: Final = {cv2.CAP_V4L2: (cv2.CAP_PROP_CONVERT_RGB, 0), cv2.CAP_FFMPEG: (cv2.CAP_PROP_FORMAT, -1)}
"""The property, and its value, that makes a backend give bytes (OpenCV, videoio flags)."""
TO_GREY: Final = {(): None, (1,): None, (3,): cv2.COLOR_BGR2GRAY, (4,): cv2.COLOR_BGRA2GRAY}
"""How OpenCV makes grey of a picture, by its channels."""


def take_jpegs(capture: cv2.VideoCapture, backend: int) -> bool:
    """Ask a capture of motion JPEG for its bytes; false where it decodes.

    Args:
        capture: opened, its size set.
        backend: of OpenCV.
    """
    if backend not in UNDECODED or round(capture.get(cv2.CAP_PROP_FOURCC)) not in MOTION_JPEG:
        return False
    return bool(capture.set(*UNDECODED[backend]))


def captured_pixels(image: npt.NDArray[np.generic], *, coded: bool) -> Grey:
    """Grey values `(h, w)` uint8 of what a capture has read.

    Args:
        image: pixels of 8 or 16 bits, or bytes in one row.
        coded: it is bytes.

    Raises:
        PictureError: no picture, or a damaged one.
    """
    if coded:
        return decode_picture(image.tobytes())
    pixels = (image.astype(np.uint16) >> 8).astype(np.uint8) if image.dtype == np.uint16 else image
    channels = pixels.shape[2:]
    if pixels.dtype != np.uint8 or pixels.size == 0 or pixels.ndim < 2 or channels not in TO_GREY:
        msg = f"no picture: {image.dtype} {image.shape}"
        raise PictureError(msg)
    code = TO_GREY[channels]
    grey = pixels if code is None else cv2.cvtColor(np.asarray(pixels, dtype=np.uint8), code)
    return np.ascontiguousarray(grey.reshape(grey.shape[:2]), dtype=np.uint8)

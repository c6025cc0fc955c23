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

from mkdaemon.vision.camera.imagecodec import decode_picture, to_grey
from mkdaemon.vision.camera.shot import PictureError

Grey = npt.NDArray[np.uint8]

MOTION_JPEG: Final = frozenset(cv2.VideoWriter.fourcc(*name) for name in ("MJPG", "mjpg", "JPEG", "jpeg"))
UNDECODED: Final = {cv2.CAP_V4L2: (cv2.CAP_PROP_CONVERT_RGB, 0), cv2.CAP_FFMPEG: (cv2.CAP_PROP_FORMAT, -1)}
"""The property, and its value, that makes a backend give bytes (OpenCV, videoio flags)."""


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
        image: pixels, or bytes in one row.
        coded: it is bytes.

    Raises:
        PictureError: no picture, or a damaged one.
    """
    if coded:
        return decode_picture(image.tobytes())
    pixels = to_grey(image)
    if pixels is None:
        msg = f"no picture: {image.dtype} {image.shape}"
        raise PictureError(msg)
    return pixels

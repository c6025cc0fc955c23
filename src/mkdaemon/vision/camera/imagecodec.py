"""Images to bytes and back; what comes from outside is checked, and refused where it is damaged.

libjpeg decodes damaged data to an image with warnings that OpenCV does not hand on: blocks are grey, repeated or out of
place. The TurboJPEG interface reports them; such an image is refused.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import msgpack
import numpy as np
import numpy.typing as npt
import simplejpeg
from pydantic import ValidationError

from mkdaemon.reading import LONGEST_PICTURE, read_bytes
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.vision.camera.picturesize import JPEG, MAX_PIXELS, picture_size
from mkdaemon.vision.camera.shot import PictureError

Grey = npt.NDArray[np.uint8]


def pack(frame: CameraFrame) -> bytes:
    """Put a frame on the wire: a msgpack map of its fields, as every value on the bus."""
    packed: bytes = msgpack.packb(frame, default=vars)
    return packed


def unpack(payload: bytes) -> tuple[CameraFrame, Grey]:
    """Read a frame from outside: the frame and its pixels `(height, width)` uint8.

    Raises:
        PictureError: it is none, or its picture is damaged.
    """
    try:
        frame = CameraFrame.model_validate(msgpack.unpackb(payload, raw=False))
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        msg = f"not an image: {'.'.join(map(str, first['loc'])) or 'payload'}: {first['msg']}"
        raise PictureError(msg) from None
    except (ValueError, msgpack.exceptions.UnpackException, TypeError) as error:
        msg = f"not an image: not msgpack ({type(error).__name__})"
        raise PictureError(msg) from None
    if frame.width * frame.height > MAX_PIXELS:
        msg = "not an image: impossible size"
        raise PictureError(msg)
    if frame.coding == "gray8":
        if len(frame.pixels) != frame.width * frame.height:
            msg = f"image of {frame.width}x{frame.height} has {len(frame.pixels)} bytes"
            raise PictureError(msg)
        return frame, np.frombuffer(frame.pixels, dtype=np.uint8).reshape(frame.height, frame.width)
    pixels = decode_picture(frame.pixels)
    if pixels.shape != (frame.height, frame.width):
        msg = f"header says {frame.width}x{frame.height}, the picture is {pixels.shape[1]}x{pixels.shape[0]}"
        raise PictureError(msg)
    return frame, pixels


def decode_picture(content: bytes) -> Grey:
    """Decode a picture to grey `(h, w)` uint8.

    Raises:
        PictureError: it is none that `picture_size` knows, is too large, or is damaged.
    """
    size = picture_size(content)
    if size is None or size[0] * size[1] > MAX_PIXELS:
        msg = "no picture that can be read"
        raise PictureError(msg)
    pixels = _decode_jpeg(content) if content.startswith(JPEG) else _decode_other(content)
    if pixels.shape != (size[1], size[0]):
        msg = f"its header says {size[0]}x{size[1]}, the picture is {pixels.shape[1]}x{pixels.shape[0]}"
        raise PictureError(msg)
    return pixels


def _decode_jpeg(content: bytes) -> Grey:
    """Grey values of a JPEG about which libjpeg has nothing to say."""
    try:
        pixels = simplejpeg.decode_jpeg(content, colorspace="GRAY", strict=True)
    except ValueError as error:
        msg = f"damaged JPEG: {error}"
        raise PictureError(msg) from None
    return np.ascontiguousarray(pixels[:, :, 0], dtype=np.uint8)


def _decode_other(content: bytes) -> Grey:
    """Grey values of a picture OpenCV decodes: a damaged PNG is none for it."""
    try:
        # the lens is fixed to the sensor: what a file says about turning the picture is left out
        how = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), how)
    except cv2.error:
        pixels = None
    if pixels is None:
        msg = "no picture that can be read"
        raise PictureError(msg)
    return np.asarray(pixels, dtype=np.uint8)


def read_picture(path: Path) -> Grey:
    """Read a picture file; see `decode_picture`.

    Raises:
        PictureError: no picture, or a damaged one.
        OSError: it cannot be read, is no regular file, or too long.
    """
    return decode_picture(read_bytes(path, LONGEST_PICTURE))


def encode_jpeg(pixels: Grey, quality: int, max_width: int) -> tuple[bytes, int, int]:
    """Compress for viewing, scaled down to at most `max_width`; returns bytes, width, height."""
    height, width = pixels.shape
    if width > max_width:
        size = (max_width, max(round(height * max_width / width), 1))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    _, coded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return coded.tobytes(), pixels.shape[1], pixels.shape[0]


def encode_png(pixels: Grey) -> bytes:
    """Compress without loss."""
    _, coded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return coded.tobytes()


def to_grey(image: npt.NDArray[np.generic]) -> Grey | None:
    """Any picture OpenCV captures to grey `(h, w)` uint8; None for something that is no picture."""
    if image.size == 0 or image.ndim not in (2, 3):
        return None
    if image.dtype == np.uint16:
        image = (image.astype(np.uint16) >> 8).astype(np.uint8)
    if image.dtype != np.uint8:
        return None
    pixels = np.asarray(image, dtype=np.uint8)
    if pixels.ndim == 3:
        if pixels.shape[2] == 1:
            pixels = pixels[:, :, 0]
        elif pixels.shape[2] in (3, 4):
            code = cv2.COLOR_BGR2GRAY if pixels.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
            pixels = np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)
        else:
            return None
    return np.ascontiguousarray(pixels)

"""Images to bytes and back; what comes from outside is checked, and refused where it is damaged.

OpenCV does not hand on libjpeg's warnings about damaged data; the TurboJPEG interface does. The size of a picture comes
from its header, before anything is decoded: a file of 130 kB may ask for a gigabyte.

Sources: PNG, RFC 2083, section 11.2.2; BMP, BITMAPINFOHEADER of the Windows API; PNM, netpbm(5).
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Final

import cv2
import msgpack
import numpy as np
import numpy.typing as npt
import simplejpeg
from pydantic import ValidationError

from mkdaemon.errors import ConfigError
from mkdaemon.files import save
from mkdaemon.foreignfiles import LONGEST_PICTURE, read_bytes
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.image import CameraImage, PictureError

MAX_PIXELS: Final = 64_000_000
JPEG: Final = b"\xff\xd8\xff"
TO_GREY: Final = {(): None, (1,): None, (3,): cv2.COLOR_BGR2GRAY, (4,): cv2.COLOR_BGRA2GRAY}
"""How OpenCV makes grey of a picture, by its channels."""
_PNM: Final = re.compile(rb"P[1-6](?:\s+|\s*#[^\n]*\n)+(\d{1,9})(?:\s+|\s*#[^\n]*\n)+(\d{1,9})\s")


def picture_size(content: bytes) -> tuple[int, int] | None:
    """Width and height [px] that a PNG, JPEG, BMP or PNM claims; None of another format, or where it is cut off."""
    try:
        if content.startswith(b"\x89PNG\r\n\x1a\n"):
            width, height = struct.unpack_from(">II", content, 16)
        elif content.startswith(JPEG):
            height, width, _, _ = simplejpeg.decode_jpeg_header(content)
        elif content.startswith(b"BM"):
            width, height = map(abs, struct.unpack_from("<ii", content, 18))
        elif found := _PNM.match(content[:4096]):
            width, height = found.groups()
        else:
            return None
    except (struct.error, ValueError):
        return None
    return int(width), int(height)


def unpack(payload: bytes) -> tuple[CameraFrame, Grey]:
    """Read a frame from outside: the frame and its pixels `(height, width)` uint8.

    Raises:
        PictureError: it is none, or its picture is damaged.
    """
    try:
        frame = CameraFrame.model_validate(msgpack.unpackb(payload))
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        msg = f"not an image: {'.'.join(map(str, first['loc'])) or 'payload'}: {first['msg']}"
        raise PictureError(msg) from None
    except (ValueError, msgpack.exceptions.UnpackException, TypeError) as error:
        msg = f"not an image: not msgpack ({type(error).__name__})"
        raise PictureError(msg) from None
    if frame.coding != "gray8":
        pixels = decode_picture(frame.pixels)
    elif len(frame.pixels) == frame.width * frame.height:
        pixels = np.frombuffer(frame.pixels, dtype=np.uint8).reshape(frame.height, frame.width)
    else:
        msg = f"image of {frame.width}x{frame.height} has {len(frame.pixels)} bytes"
        raise PictureError(msg)
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
        raise PictureError("no picture that can be read")
    try:
        if content.startswith(JPEG):
            pixels = simplejpeg.decode_jpeg(content, colorspace="GRAY", strict=True)[:, :, 0]
        else:
            # the lens is fixed to the sensor: what a file says about turning the picture is left out
            how = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
            pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), how)
    except ValueError as error:  # libjpeg has something to say
        msg = f"damaged JPEG: {error}"
        raise PictureError(msg) from None
    except cv2.error:
        pixels = None
    if pixels is None:  # a damaged PNG, too
        raise PictureError("no picture that can be read")
    return np.ascontiguousarray(pixels, dtype=np.uint8)


def captured_pixels(image: npt.NDArray[np.generic]) -> Grey:
    """Grey values `(h, w)` uint8 of what a capture has read: pixels of 8 or 16 bits, or a row of coded bytes.

    Raises:
        PictureError: no picture, or a damaged one.
    """
    if image.shape[0] == 1:
        return decode_picture(image.tobytes())
    if image.dtype not in (np.uint8, np.uint16) or image.size == 0 or image.shape[2:] not in TO_GREY:
        msg = f"no picture: {image.dtype} {image.shape}"
        raise PictureError(msg)
    pixels = (image.astype(np.uint16) >> 8 if image.dtype == np.uint16 else image).astype(np.uint8, copy=False)
    code = TO_GREY[image.shape[2:]]
    grey = pixels if code is None else cv2.cvtColor(pixels, code)
    return np.ascontiguousarray(grey.reshape(grey.shape[:2]), dtype=np.uint8)


def read_picture(path: Path) -> Grey:
    """Read a picture file; see `decode_picture`.

    Raises:
        PictureError: no picture, a damaged one, or it cannot be read, is no regular file, or too long.
    """
    try:
        return decode_picture(read_bytes(path, LONGEST_PICTURE))
    except OSError as error:
        raise PictureError(error.strerror or "cannot be read") from error


def encode_jpeg(pixels: Grey, quality: int, max_width: int) -> tuple[bytes, int, int]:
    """Compress for viewing, scaled down to at most `max_width`; returns bytes, width, height."""
    height, width = pixels.shape
    if width > max_width:
        size = (max_width, max(round(height * max_width / width), 1))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    _, coded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return coded.tobytes(), pixels.shape[1], pixels.shape[0]


def frame_of(image: CameraImage, stamp: Stamp, quality: int | None, max_width: int) -> CameraFrame:
    """The image as JPEG of a quality, at most so wide [px]; without a quality whole, as PNG."""
    if quality is None:
        _, coded = cv2.imencode(".png", image.pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        pixels, (height, width) = coded.tobytes(), image.pixels.shape
    else:
        pixels, width, height = encode_jpeg(image.pixels, quality, max_width)
    return CameraFrame(
        stamp=stamp,
        camera=image.camera,
        sequence=image.sequence,
        width=width,
        height=height,
        coding="png" if quality is None else "jpeg",
        pixels=pixels,
    )


def write_picture(path: Path, pixels: Grey, *, overwrite: bool = False) -> None:
    """Write a picture, `(h, w, 3)` blue-green-red or `(h, w)` grey, whole or not at all; the suffix is the format.

    Raises:
        ConfigError: the file is there already and `overwrite` is off, or no format has this suffix.
        MkError: it cannot be written; what was there is untouched.
    """
    try:
        is_encoded, content = cv2.imencode(path.suffix, pixels)
    except cv2.error:
        is_encoded = False
    if not is_encoded:
        msg = f"{path}: no format of pictures has this suffix; use .png or .jpg"
        raise ConfigError(msg)
    save(path, content.tobytes(), overwrite=overwrite)

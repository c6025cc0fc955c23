"""Images of a bus or a recording as small pictures that programs can show."""

from __future__ import annotations

import struct
import zlib

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.image import CameraFrame


def small_jpeg(payload: bytes, width: int, quality: int = 75) -> bytes | None:
    """A `CameraFrame` as a JPEG that is not too wide; None where it is none, or damaged.

    Args:
        payload: as published under `vision/<camera>/image`.
        width: it is scaled down to this [px].
        quality: of the JPEG, 1 to 100.

    Raises:
        ConfigError: OpenCV is not installed.
    """
    try:
        from mkdaemon.vision.camera.imagecodec import encode_jpeg, unpack
    except ImportError:
        raise ConfigError('pictures of a camera need OpenCV: pip install "mkdaemon[vision]"') from None
    try:
        _, pixels = unpack(payload)
        return encode_jpeg(pixels, quality, width)[0]
    except MkError:
        return None


def decoded(coded: bytes) -> bytes | None:
    """Pixels of a JPEG or PNG, rows from the top; None where they are damaged, or OpenCV is not there."""
    try:
        from mkdaemon.vision.camera.image import PictureError
        from mkdaemon.vision.camera.imagecodec import decode_picture
    except ImportError:
        return None
    try:
        return decode_picture(coded).tobytes()
    except PictureError:
        return None


def viewable(image: CameraFrame) -> tuple[bytes, str]:
    """An image as every program reads it, without OpenCV: its bytes, and `jpeg` or `png`."""
    if image.coding != "gray8":
        return image.pixels, image.coding
    rows = range(0, image.width * image.height, image.width)
    scan = b"".join(b"\0" + image.pixels[row : row + image.width] for row in rows)
    head = struct.pack(">IIBBBBB", image.width, image.height, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(scan, 1)), (b"IEND", b""))
    png = b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + png, "png"

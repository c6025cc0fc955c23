"""Images of a bus or a recording as small pictures that programs can show."""

from __future__ import annotations

from mkdaemon.errors import ConfigError, MkError


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
        msg = 'pictures of a camera need OpenCV: pip install "mkdaemon[vision]"'
        raise ConfigError(msg) from None
    try:
        _, pixels = unpack(payload)
        return encode_jpeg(pixels, quality, width)[0]
    except MkError:
        return None

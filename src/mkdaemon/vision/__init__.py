"""Tag localisation: cameras, calibration, detection, pose, tracking. It needs the extra `vision` (OpenCV)."""

from __future__ import annotations

from importlib.util import find_spec

from mkdaemon.errors import ConfigError

NO_OPENCV = "cameras and tags need OpenCV, which is not installed: pip install 'mkdaemon[vision]'"


def require_opencv() -> None:
    """Check that OpenCV is installed.

    Raises:
        ConfigError: it is not; says what to install.
    """
    if find_spec("cv2") is None:
        raise ConfigError(NO_OPENCV)


require_opencv()

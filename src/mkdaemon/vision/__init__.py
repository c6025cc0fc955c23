"""Tag localisation: cameras, calibration, detection, pose, tracking. It needs the extra `vision` (OpenCV)."""

from __future__ import annotations

from importlib.util import find_spec

from mkdaemon.errors import ConfigError

if find_spec("cv2") is None:
    raise ConfigError("cameras and tags need OpenCV, which is not installed: pip install 'mkdaemon[vision]'")

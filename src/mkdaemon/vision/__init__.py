"""Tag localisation: cameras, calibration, detection, pose, tracking. It needs the extra `vision`."""

from __future__ import annotations

from importlib.util import find_spec

from mkdaemon.errors import ConfigError

for _module, _name in (("cv2", "OpenCV"), ("pyapriltags", "pyapriltags"), ("simplejpeg", "simplejpeg")):
    if find_spec(_module) is None:
        msg = f"cameras and tags need {_name}, which is not installed: pip install 'mkdaemon[vision]'"
        raise ConfigError(msg)

"""What the simulated camera sees. It needs the extra `sim` (OpenCV)."""

from importlib.util import find_spec
from typing import Final

from mkdaemon.errors import ConfigError

NO_OPENCV: Final = "the simulated camera needs OpenCV, which is not installed: pip install 'mkdaemon[sim]'"

if find_spec("cv2") is None:
    raise ConfigError(NO_OPENCV)

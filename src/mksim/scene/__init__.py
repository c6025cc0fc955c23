"""What the simulated camera sees. It needs the extra `vision` (OpenCV)."""

from mkdaemon.vision import require_opencv

require_opencv()

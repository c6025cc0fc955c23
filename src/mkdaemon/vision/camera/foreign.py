"""Calibrations of other programs: ROS `camera_info` YAML, `ost.txt` of ROS's calibrator, and Kalibr's camchain.

All have pixel centres at integer coordinates and OpenCV's coefficients, as our camera file. What a camera file cannot
say (a rational or omnidirectional lens, skew, several cameras) is refused by name. Sources: ROS
`sensor_msgs/CameraInfo`, `camera_calibration_parsers`; Kalibr wiki, "Yaml formats", "Supported models".
"""

from __future__ import annotations

import math
import re
from typing import Any, Final, NamedTuple

from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import parse_number

_PLAIN: Final = ("k1", "k2", "p1", "p2", "k3")
_FISHEYE: Final = ("k1", "k2", "k3", "k4")
_MODELS: Final = {
    "plumb_bob": ("pinhole", _PLAIN),
    "radtan": ("pinhole", _PLAIN),
    "rational_polynomial": ("pinhole", _PLAIN),
    "none": ("pinhole", ()),
    "equidistant": ("fisheye", _FISHEYE),
    "fisheye": ("fisheye", _FISHEYE),
}
"""By their word: our model, and the coefficients in their order; further ones have to be 0."""
_LIST: Final = r"(\[[^\]]*\]|(?:\n[ \t]*-[^\n\-][^\n]*)+)"
_INSTEAD: Final = "calibrate it with mkdaemon calibrate camera"


class Figures(NamedTuple):
    """Figures of another program's calibration.

    Attributes:
        name: of the camera.
        intrinsics: the keys of `Intrinsics`.
    """

    name: str
    intrinsics: dict[str, Any]


def figures_of(text: str) -> Figures | None:
    """Read a calibration of another program; None where the text is none.

    Raises:
        ConfigError: a figure is missing or wrong, or the lens has no place in a camera file; says what to do.
    """
    if re.search(r"^\[image\]\s*$", text, re.MULTILINE) and "camera matrix" in text:
        return _ost(text)
    if re.search(r"^camera_matrix:", text, re.MULTILINE):
        return _ros(text)
    if re.search(r"^\s+distortion_coeffs:", text, re.MULTILINE):
        return _kalibr(text)
    return None


def _ros(text: str) -> Figures:
    size = [_numbers(_line(text, key), key, 1)[0] for key in ("image_width", "image_height")]
    matrix = _numbers(_data(text, "camera_matrix"), "camera_matrix", 9)
    coefficients = _numbers(_data(text, "distortion_coefficients"), "distortion_coefficients")
    name = _line(text, "camera_name", "").strip("\"'")
    return _figures(name, size, matrix, _line(text, "distortion_model", "plumb_bob"), coefficients)


def _ost(text: str) -> Figures:
    size = [_numbers(_below(text, key, 1), key, 1)[0] for key in ("width", "height")]
    matrix = _numbers(_below(text, "camera matrix", 3), "camera matrix", 9)
    coefficients = _numbers(_below(text, "distortion", 1), "distortion")
    names = [name for name in re.findall(r"^\[(.+)\]\s*$", text, re.MULTILINE) if name != "image"]
    return _figures(names[0] if names else "", size, matrix, "plumb_bob", coefficients)


def _kalibr(text: str) -> Figures:
    cameras = re.findall(r"^(\w+):\s*$", text, re.MULTILINE)
    if len(cameras) != 1:
        raise ConfigError(f"the file holds {len(cameras)} cameras; keep the lines of one of them")
    camera = _line(text, "camera_model", "pinhole")
    if camera != "pinhole":
        raise ConfigError(f"camera_model {camera} has no place in a camera file; {_INSTEAD}")
    fx, fy, cx, cy = _numbers(_flow(text, "intrinsics"), "intrinsics", 4)
    size = _numbers(_flow(text, "resolution"), "resolution", 2)
    coefficients = _numbers(_flow(text, "distortion_coeffs"), "distortion_coeffs")
    model = _line(text, "distortion_model", "none")
    return _figures(cameras[0], size, [fx, 0, cx, 0, fy, cy, 0, 0, 1], model, coefficients)


def _figures(name: str, size: list[float], matrix: list[float], word: str, coefficients: list[float]) -> Figures:
    if word not in _MODELS:
        raise ConfigError(f"distortion_model {word} is not known; use one of {', '.join(_MODELS)}")
    model, names = _MODELS[word]
    if any(coefficients[len(names) :]):
        more = ", ".join(f"{value:g}" for value in coefficients[len(names) :])
        raise ConfigError(
            f"{word} with {more} after {len(names)} coefficients has no place in a camera file; {_INSTEAD}"
        )
    if any(value != int(value) for value in size):
        raise ConfigError("the size of the image is not a whole number; correct it")
    fx, skew, cx, _, fy, cy, *_ = matrix
    if skew:
        raise ConfigError(f"a skew of {skew:g} has no place in a camera file; {_INSTEAD}")
    width, height = (int(value) for value in size)
    known = dict(zip(names, coefficients, strict=False))
    return Figures(
        name, {"width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "model": model, **known}
    )


def _line(text: str, key: str, default: str | None = None) -> str:
    """What stands behind a key, without a comment."""
    found = re.search(rf"^[ \t]*{key}:[ \t]*([^#\n]+)", text, re.MULTILINE)
    if found is None and default is None:
        raise ConfigError(f"{key} is missing; export the calibration again")
    return (default or "") if found is None else found[1].strip()


def _flow(text: str, key: str) -> str:
    return _matched(re.search(rf"^[ \t]*{key}:[ \t]*{_LIST}", text, re.MULTILINE), key)


def _data(text: str, key: str) -> str:
    """The list `data` of a matrix."""
    return _matched(
        re.search(rf"^{key}:[ \t]*\n(?:[ \t]+(?!data)[^\n]*\n)*[ \t]+data:[ \t]*{_LIST}", text, re.MULTILINE), key
    )


def _below(text: str, key: str, rows: int) -> str:
    """Lines below a heading of `ost.txt`."""
    return _matched(re.search(rf"^{key}[ \t]*\n((?:[^\n]*(?:\n|$)){{{rows}}})", text, re.MULTILINE), key)


def _matched(found: re.Match[str] | None, key: str) -> str:
    if found is None:
        raise ConfigError(f"{key} is missing; export the calibration again")
    return found[1]


def _numbers(text: str, key: str, count: int | None = None) -> list[float]:
    words = re.sub(r"(?:^|(?<=\n))[ \t]*- |[\[\],]", " ", text).split()
    try:
        values = [parse_number(word) for word in words]
    except ValueError:
        raise ConfigError(f"{key} holds what is not a number; export the calibration again") from None
    if not all(map(math.isfinite, values)) or (count is not None and len(values) != count):
        wanted = "finite numbers" if count is None else f"{count} finite numbers"
        raise ConfigError(f"{key} needs {wanted}; export the calibration again")
    return values

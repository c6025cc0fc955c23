"""`mkdaemon calibrate shutter`: the line time of a rolling shutter into the camera file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.printing import json_line
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.vision.calibrate.calibration import line_time_of
from mkdaemon.vision.camera.calibration_file import load_camera, save_camera
from mkdaemon.vision.camera.imagecodec import read_picture
from mkdaemon.vision.camera.sources import list_pictures

READOUT_MS: Final = 60.0
"""A readout of all rows longer than this is none [ms]."""


def shutter(
    file: Annotated[Path, Parameter(help="Camera file to write.")],
    pictures: Annotated[Path, Parameter(help="Folder of pictures of a plain wall, nothing moving.")],
    /,
    *,
    mains: Annotated[Literal["50", "60"], Parameter(help="Frequency of the mains [Hz].")] = "50",
    store: Annotated[bool, Parameter(negative=(), help="Write it into the camera file.")] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), help="Answer as one JSON object.")] = False,
) -> None:
    """Measure the time between rows from the bands that a lamp on mains makes.

    Hold the camera still before a plain wall under a lamp that flickers (fluorescent, cheap LED), exposure below 5 ms,
    and keep ten or more pictures at the size of the calibration. A global shutter shows no bands.

    Example: mkdaemon calibrate shutter camera.toml pictures/ --mains 50

    Raises:
        ConfigError: the camera file cannot be used, or the pictures are of another size.
        VisionError: too few pictures, or no bands in them.
    """
    camera = load_camera(file)
    k = camera.intrinsics
    images = [read_picture(path) for path in list_pictures(pictures)]
    if any(image.shape != (k.height, k.width) for image in images):
        msg = f"{pictures}: pictures of another size than {k.width}x{k.height}, which {file} is for"
        raise ConfigError(msg)
    line_time, sd = line_time_of(images, 2.0 * float(mains))
    readout_ms = 1000.0 * line_time * k.height
    if readout_ms > READOUT_MS:
        msg = f"the bands would mean a readout of {readout_ms:.0f} ms: something else moves in the pictures"
        raise VisionError(msg)
    if store:
        changed = k.model_copy(update={"line_time": round(line_time, 9)})
        save_camera(camera.model_copy(update={"intrinsics": changed}), file, overwrite=True)
    if as_json:
        print(json_line({"before": k.line_time, "line_time": line_time, "sd": sd, "stored": store}))
        return
    before = "none" if k.line_time is None else f"{1e6 * k.line_time:.2f}"
    print(f"line time {1e6 * line_time:.2f} +- {1e6 * sd:.2f} us, readout {readout_ms:.1f} ms; the file has {before}")
    print(f"stored in {file}" if store else f"nothing written; --store writes it into {file}")

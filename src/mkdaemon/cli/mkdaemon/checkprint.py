"""`mkdaemon calibrate check-print`: is the print to scale, flat, sharp, with its white rim?"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson, Length
from mkdaemon.cli.console import Console
from mkdaemon.cli.mkdaemon.printtarget import target_of
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.foreignfiles import LONGEST_PICTURE, read_bytes
from mkdaemon.vision.calibrate.printcheck import check_print as find_faults
from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import decode_picture


def check_print(
    photo: Annotated[Path, Parameter(help="A photograph that shows the whole print.")],
    /,
    *,
    target: Annotated[Path, Parameter(help="Target file of what was printed: configs/targets/nested.toml.")],
    camera: Annotated[Path | None, Parameter(help="Camera file of `mkdaemon calibrate camera`.")] = None,
    distance: Annotated[Length | None, Parameter(help="Lens to the middle of the largest tag, by tape [m].")] = None,
    as_json: AsJson = False,
) -> int:
    """Judge a print by one photograph: sizes, flatness, sharpness, light and the white rim. Needs no daemon.

    One photograph cannot tell sizes that are all wrong by one factor, unless it is of a calibrated camera and you give
    the distance by tape; nor a bend that the camera looks along. Exit code 1 where something is bad.

    Example: mkdaemon calibrate check-print print.jpg --target configs/targets/nested.toml --distance 1.5

    Raises:
        ConfigError: a file cannot be used, or the picture is of another size than the camera.
        MkError: the picture cannot be read.
    """
    intrinsics = None if camera is None else load_camera(camera).intrinsics
    try:
        pixels = decode_picture(read_bytes(photo, LONGEST_PICTURE))
    except OSError as error:
        raise ConfigError(f"{photo}: {error.strerror or 'cannot be read'}") from None
    except PictureError as error:
        raise MkError(f"{photo}: {error}") from None
    height, width = pixels.shape
    if intrinsics is not None and (intrinsics.width, intrinsics.height) != (width, height):
        raise ConfigError(f"{photo} is {width}x{height}, the calibration is for {intrinsics.width}x{intrinsics.height}")
    findings = find_faults(pixels, target_of(target), intrinsics, distance)
    is_bad = any(finding.state == "bad" for finding in findings)
    if as_json:
        print(json_line({"is_good": not is_bad, "findings": [asdict(finding) for finding in findings]}))
        return EXIT_FAILURE if is_bad else EXIT_OK
    console = Console()
    for finding in sorted(findings, key=lambda finding: ("bad", "unknown", "good").index(finding.state)):
        console.print(f"{finding.state.upper():<8} {finding.name}: {finding.words}", soft_wrap=True)
        if finding.fix and finding.state != "good":
            console.print(f"         {finding.fix}", soft_wrap=True)
    return EXIT_FAILURE if is_bad else EXIT_OK

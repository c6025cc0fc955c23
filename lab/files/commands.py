"""Every command line that reads a file, by the kind of file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from lab.files.originals import Kind


@dataclass(frozen=True, slots=True)
class Reader:
    """A command that reads a file.

    Attributes:
        program: which one.
        words: of the command line; `{file}` is the hostile one, `{parent}` its folder, `{folder}` an empty folder,
            `{good}` a good file of the same kind, `{picture}` and `{camera}` good ones too.
        kind: of the file.
    """

    program: Literal["mkctl", "mkdaemon"]
    words: tuple[str, ...]
    kind: Kind

    @property
    def name(self) -> str:
        """How it is called."""
        return " ".join((self.program, *self.words)).replace("{file}", f"FILE{self.kind}")


def _mkctl(kind: Kind, *lines: str) -> list[Reader]:
    return [Reader("mkctl", tuple(line.split()), kind) for line in lines]


def _mkdaemon(kind: Kind, *lines: str) -> list[Reader]:
    return [Reader("mkdaemon", tuple(line.split()), kind) for line in lines]


_MISSIONS: Final = (Kind.GPX, Kind.KML, Kind.PLAN, Kind.CSV, Kind.WPL)
_NOBODY: Final = "--connect tcp/127.0.0.1:9"
"""Where no daemon is."""

READERS: Final = (
    *(one for kind in _MISSIONS for one in _mkctl(kind, "waypoints convert {file} {folder}/out.csv --altitude 10")),
    *_mkctl(Kind.GPX, f"waypoints upload {{file}} --start-elevation 500 {_NOBODY}"),
    *_mkctl(Kind.SETTINGS_TOML, "settings compare {file} {good}", f"settings restore {{file}} {_NOBODY}"),
    *_mkctl(Kind.SETTINGS_JSON, "settings compare {good} {file}"),
    *_mkctl(Kind.MIXER, f"board mixer write {{file}} --confirm {_NOBODY}"),
    *_mkctl(Kind.SCRIPT, "fly --check {file}"),
    *_mkctl(Kind.GAMEPAD, f"teleop --mapping {{file}} --joy a {_NOBODY}"),
    *_mkctl(Kind.PAD_SESSION, f"teleop --replay {{file}} {_NOBODY}"),
    *_mkctl(Kind.PROBES, f"linktest --compare {{file}} {_NOBODY}"),
    *(one for kind in (Kind.PICTURE, Kind.JPEG) for one in _mkdaemon(kind, "calibrate check-print {file}")),
    *_mkctl(Kind.ZENOH, f"status --zenoh-file {{file}} {_NOBODY}"),
    *_mkctl(
        Kind.RECORDING,
        "log info {file}",
        "log verify --json {file}",
        "log repair {file} -o {folder}/out.mcap",
        "log repair {file} -o {folder}/out.mcap --viewer",
        "log cut {file} -o {folder}/out.mcap --from 1 --to -0.5",
        "log merge {file} {good} -o {folder}/out.mcap",
        "log export {file} -f csv -o {folder}/out",
        "log export {file} -f parquet -o {folder}/out",
        "log export {file} -f gpx -o {folder}/out.gpx",
        "log export {file} -f kml -o {folder}/out.kml",
        "log export {file} -f ros -o {folder}/out",
        "log report {file} -o {folder}/out.html",
        "log play {file} --wait 0 --speed 1000 --listen unixsock-stream/{folder}/play",
    ),
    *_mkdaemon(Kind.RECORDING, "replay --verify {file}"),
    *_mkdaemon(
        Kind.CONFIG,
        "doctor --config {file}",
        "config check {file}",
        "config show {file}",
        "run --config {file} --port /dev/ttyABSENT --no-record",
    ),
    *_mkdaemon(Kind.ZENOH, "security show {file}"),
    *_mkdaemon(
        Kind.CAPTURE,
        "decode {file}",
        "run --port replay:{file}?speed=10000 --no-record --listen unixsock-stream/{folder}/run",
    ),
    *_mkdaemon(Kind.BYTES, "decode {file}"),
    *_mkdaemon(Kind.PICTURE, "detect {file} --tag-size 0.1 --intrinsics 200,200,80,60"),
    *_mkdaemon(
        Kind.JPEG,
        "detect {file}",
        "calibrate shutter {camera} {parent}",
        "calibrate camera {parent} -o {folder}/out.toml",
    ),
    *_mkdaemon(Kind.CLIP, "detect {file}"),
    *_mkdaemon(Kind.CAMERA, "detect {picture} --camera {file}"),
    *_mkdaemon(Kind.TARGET, "detect {picture} --target {file}", "calibrate print {folder}/out.svg --target {file}"),
)
"""All of them."""

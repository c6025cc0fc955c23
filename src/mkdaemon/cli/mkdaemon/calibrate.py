"""`mkdaemon calibrate`: intrinsics by pictures of a board or live with guidance, mounting by a flight, line time."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from cyclopts import App, Parameter
from rich.live import Live
from rich.text import Text

from mkdaemon.bus.session import open_session, session_config
from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import Console
from mkdaemon.cli.printing import json_line, show
from mkdaemon.client import connect
from mkdaemon.client.connection import DEFAULT_ENDPOINT, DEFAULT_VEHICLE
from mkdaemon.config.camera import CameraSection, MountSection
from mkdaemon.errors import ConfigError, MkError, VisionError
from mkdaemon.files import refuse_existing
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.calibrate.board import CalibrationBoard, CharucoBoard, TagBoard
from mkdaemon.vision.calibrate.calibration import CalibrationResult, calibrate, line_time_of
from mkdaemon.vision.calibrate.views import ViewReport, Views
from mkdaemon.vision.camera.calibration_file import CalibrationRecord, Camera, load_camera, save_camera
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.camera.imagecodec import read_picture
from mkdaemon.vision.camera.sources import list_pictures, source_of
from mkdaemon.vision.tags.targetfile import load

app = App(name="calibrate", help="Targets to print, camera calibration, camera mounting.")
app.command("mkdaemon.cli.mkdaemon.printtarget:print_target", name="print")
app.command("mkdaemon.cli.mkdaemon.checkprint:check_print", name="check-print")
app.command("mkdaemon.cli.mkdaemon.calibratemap:survey_map", name="map")

GUIDE_EVERY: Final = 1.5
PATIENCE_TIME: Final = 10.0
KNOWN_DEG: Final = 0.5
"""Deviation of roll and pitch up to which a mounting is stored [deg]."""
SAME_DEG: Final = 0.05
"""Angles that differ by less are the same [deg]."""
READOUT_MS: Final = 60.0
"""A readout of all rows longer than this is none [ms]."""

Looks = Literal["down", "forward", "back", "left", "right", "up"]


@app.command
def camera(
    images: Annotated[Path | None, Parameter(help="Folder of pictures of the board; default: a live camera.")] = None,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Camera file to write.")] = Path("camera.toml"),
    board: Annotated[
        str, Parameter(help="`charuco:COLUMNSxROWS:SQUARE` [m] as `calibrate print` makes it, or `target:FILE.toml`.")
    ] = "charuco:9x6:0.03",
    source: Annotated[str | None, Parameter(help="Live: /dev/video0, rtsp://..., zenoh:KEY, file:CLIP.")] = None,
    width: Annotated[int | None, Parameter(help="Live: wanted width [px].")] = None,
    height: Annotated[int | None, Parameter(help="Live: wanted height [px].")] = None,
    keep: Annotated[Path | None, Parameter(help="Live: keep the pictures taken in this folder.")] = None,
    seconds: Annotated[float, Parameter(help="Live: give up after this time [s].")] = 300.0,
    connect: Annotated[str, Parameter(env_var="MK_CONNECT", help="Zenoh endpoint for zenoh: sources.")] = (
        "tcp/127.0.0.1:7447"
    ),
    name: Annotated[str, Parameter(help="Name of the camera, kept in the file.")] = "",
    lens: Annotated[str, Parameter(help="Lens and focus, kept in the file.")] = "",
    looks: Annotated[Looks, Parameter(help="Direction of view on the vehicle.")] = "down",
    mount: Annotated[tuple[float, float, float], Parameter(help="Lens in the body frame: forward, left, up [m].")] = (
        0.0,
        0.0,
        0.0,
    ),
    fisheye: Annotated[bool, Parameter(help="A fisheye: wider than about 100 deg.")] = False,
    accept_poor: Annotated[bool, Parameter(help="Store a poor calibration anyway.")] = False,
    force: Annotated[bool, Parameter(help="Overwrite existing files.")] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate a camera and write its camera file.

    Glue a board (`mkdaemon calibrate print board.pdf --charuco 9x6 --square 0.03`) to something flat, take 15 to 30
    sharp pictures: in every part, near and far, tilted to every side by 30 deg. Live, it says what is missing.

    Example: mkdaemon calibrate camera 'photos/*.jpg' --output camera.toml

    Raises:
        ConfigError: the board, the pictures or the source cannot be used.
        VisionError: too few pictures, or it is poor and `--accept-poor` was not given.
        MkError: a file cannot be written.
    """
    if (images is None) == (source is None):
        raise ConfigError("give a folder of pictures, or --source for a live camera")
    _refuse_existing(output, keep, overwrite=force)
    shown = _board(board)
    if images is not None:
        views = _from_folder(images, shown, quiet=as_json)
    else:
        cfg = CameraSection(source=str(source), width=width, height=height)
        views = _live(cfg, shown, keep, seconds, connect, quiet=as_json)
    result = calibrate(views.taken, is_fisheye=fisheye)
    _show(result, views, output, accept_poor=accept_poor, as_json=as_json)
    where, record = MountSection(position_flu=mount, looks=looks), _record(result, lens, shown.title)
    found = Camera(name=name, intrinsics=result.intrinsics, mount=where, calibration=record)
    save_camera(found, output, overwrite=force)
    if not as_json:
        print(f"stored in {output}")


def _refuse_existing(output: Path, keep: Path | None, *, overwrite: bool) -> None:
    """Refuse to write over files, and make the folder of the camera file."""
    for file in [output] if keep is None else [output, *sorted(keep.glob("view*.png"))]:
        refuse_existing(file, overwrite=overwrite)
    output.parent.mkdir(parents=True, exist_ok=True)


def _show(result: CalibrationResult, views: Views, output: Path, *, accept_poor: bool, as_json: bool) -> None:
    """Print what was found; it is an error where it is poor and not to be stored."""
    faults = result.faults()
    if as_json:
        print(json_line(_summary(result, views, str(output), stored=not faults or accept_poor)))
    else:
        _explain(result, views)
    if faults and not accept_poor:
        raise VisionError(f"calibration refused: {'; '.join(faults)} (or store it with --accept-poor)")


def _record(result: CalibrationResult, lens: str, board: str) -> CalibrationRecord:
    """What the camera file says about how it came about."""
    return CalibrationRecord(
        date=datetime.now(UTC).date().isoformat(),
        lens=lens,
        board=board,
        views=len(result.used),
        **_figures(result),
        k1_sd=round(result.sd["k1"], 6),
        forced=bool(result.faults()),
    )


def _figures(result: CalibrationResult) -> dict[str, float]:
    """How well it fits."""
    digits = {"rms_px": 4, "focal_sd_percent": 4, "centre_sd_px": 3}
    return {name: round(getattr(result, name), places) for name, places in digits.items()}


def _board(text: str) -> CalibrationBoard:
    """Read `charuco:9x6:0.03` or `target:FILE`."""
    kind, _, rest = text.partition(":")
    if kind == "target" and rest:
        targets = load([Path(rest)]).targets
        if len(targets) == 1:
            return TagBoard(targets[0])
    if kind == "charuco":
        size, _, square = rest.partition(":")
        columns, _, rows = size.lower().partition("x")
        if columns.isdigit() and rows.isdigit():
            try:
                return CharucoBoard(int(columns), int(rows), float(square))
            except ValueError:
                pass
    msg = f"--board '{text}': give charuco:COLUMNSxROWS:SQUARE, for example charuco:9x6:0.03, or target:FILE.toml"
    raise ConfigError(msg)


def _from_folder(folder: Path, board: CalibrationBoard, *, quiet: bool) -> Views:
    views = Views(board)
    for report in views.take_folder(folder):
        if not quiet:
            print(f"{report.name}: {report.words}")
    return views


@contextmanager
def _streaming(cfg: CameraSection, connect: str) -> Iterator[tuple[CameraStream, NewestSlot[CameraImage]]]:
    """Run the camera; a bus session is opened only for a source on the bus."""
    with ExitStack() as stack:
        session = None
        if cfg.source.startswith("zenoh:"):
            session = stack.enter_context(asyncio.run(open_session(session_config("client", connect=[connect]))))
        slot: NewestSlot[CameraImage] = NewestSlot()
        stream = CameraStream(cfg, source_of(cfg, None if session is None else lambda: session), slot)
        stream.start()
        stack.callback(stream.stop)
        yield stream, slot


def _live(
    cfg: CameraSection, board: CalibrationBoard, keep: Path | None, seconds: float, connect: str, *, quiet: bool
) -> Views:
    """Guide until the views will do, the time is over, or Ctrl-C says that is enough."""
    views = Views(board, keep)
    deadline, received_at, guided_at = time.monotonic() + seconds, time.monotonic(), -math.inf
    received = False
    with _streaming(cfg, connect) as (stream, slot), _guiding(quiet=quiet) as (show, pause):
        try:
            while time.monotonic() < deadline:
                image = slot.take(0.2)
                now = time.monotonic()
                status = stream.status()
                if image is None:
                    if status.state is EyeState.ENDED:
                        break
                    if now - received_at > PATIENCE_TIME:
                        raise VisionError(status.reason or f"no image from {cfg.source} for {PATIENCE_TIME:g} s")
                    continue
                received, received_at = True, now
                report = views.take(f"image {image.sequence}", image.pixels, is_live=True)
                if report.is_taken or now - guided_at > pause:
                    guided_at = now
                    show(_guidance(report, views))
                if not views.missing():
                    break
        except KeyboardInterrupt:
            print("enough, calibrating", file=sys.stderr)
    if not received:
        raise VisionError(f"no image from {cfg.source}: {stream.status().reason}")
    return views


@contextmanager
def _guiding(*, quiet: bool) -> Iterator[tuple[Callable[[str], None], float]]:
    """What shows guidance, in place on a terminal, and the pause before the next where no view is taken [s]."""
    console = Console()
    if quiet or not console.is_terminal:
        yield (lambda words: None) if quiet else print, GUIDE_EVERY
        return
    with Live(console=console, refresh_per_second=8) as live:
        yield lambda words: live.update(Text(words)), 0.0


def _guidance(report: ViewReport, views: Views) -> str:
    """How far it is, what became of the newest image, and what to do next."""
    missing = views.missing()
    outcome = "taken" if report.is_taken else report.words
    following = missing[0] if missing else "done"
    return f"[{100 * views.share():3.0f} %] {len(views.taken)} views, {outcome}. Next: {following}"


def _explain(result: CalibrationResult, views: Views) -> None:
    k = result.intrinsics
    print(f"{len(result.used)} of {len(views.taken)} views used, rms {result.rms_px:.3f} px")
    for name, sd in result.sd.items():
        unit = " px" if name in ("fx", "fy", "cx", "cy") else ""
        print(f"  {name} = {getattr(k, name):10.4f} +- {sd:.4f}{unit}")
    print(f"  focal length known to {result.focal_sd_percent:.3f} %, image centre to {result.centre_sd_px:.2f} px")
    for words in views.missing():
        print(f"  better with: {words}")
    print(f"  tone curve (gamma) {result.tone}")


def _summary(result: CalibrationResult, views: Views, output: str, *, stored: bool) -> dict[str, object]:
    return {
        "file": output if stored else None,
        "intrinsics": result.intrinsics.model_dump(),
        "sd": {name: round(sd, 6) for name, sd in result.sd.items()},
        **_figures(result),
        "tilt_deg": round(result.tilt_deg, 1),
        "views": len(views.taken),
        "views_used": len(result.used),
        "faults": result.faults(),
        "missing": views.missing(),
    }


@app.command(name="mount")
async def mount_of_flight(
    file: Annotated[Path, Parameter(help="Camera file the daemon flies with.")],
    /,
    *,
    camera: Annotated[str | None, Parameter(help="Name of the camera; by default the only one.")] = None,
    store: Annotated[bool, Parameter(help="Write the angles into the camera file.")] = False,
    vehicle: Annotated[str, Parameter(env_var="MK_VEHICLE", help="Name of the vehicle.")] = DEFAULT_VEHICLE,
    connect_to: Annotated[
        str, Parameter(name="--connect", env_var="MK_CONNECT", help="Zenoh endpoint of the daemon.")
    ] = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Compare `mount.rpy_deg` of a camera file with what the running daemon saw in flight, and store it if asked.

    Fly for ten seconds over a level target and turn (yaw) by 60 degrees to both sides: without turning, a camera that
    sits askew and a target that lies askew look the same. The daemon reads the file when it starts.

    Example: mkdaemon calibrate mount camera.toml --camera down --store

    Raises:
        ConfigError: the camera file cannot be used, or is not the one the daemon flies with.
        MkError: no daemon, no such camera, or the flight does not say it yet.
    """
    before = load_camera(file)
    async with connect(vehicle, connect_to) as client:
        found = await client.get_all(f"vision/{camera or '*'}/stats")
        absence = await client.absence() if not found else ""
    if len(found) != 1:
        names = ", ".join(sorted(suffix.split("/")[1] for suffix in found))
        choice = f"cameras {names}: give one with --camera" if names else ""
        raise MkError(choice or absence or "no camera reports: is one configured?")
    estimate = _estimate(next(iter(found.values())).fields, before.mount, file)
    after = before.mount.model_copy(update={"rpy_deg": tuple(round(angle, 2) for angle in estimate.mount_rpy_deg)})
    if store:
        save_camera(before.model_copy(update={"mount": after}), file, overwrite=True)
    turn, sd = _words(estimate.mounting_deg), _words(estimate.mounting_sd_deg)
    words = f"mount.rpy_deg  file {_words(before.mount.rpy_deg)}  flight {_words(after.rpy_deg)}\n"
    words += f"turned by {turn} +- {sd} deg, from {estimate.looks} images\n"
    words += f"stored in {file}; restart the daemon" if store else f"nothing written; --store writes it into {file}"
    changed = {"before": before.mount.rpy_deg, "after": after.rpy_deg, "stored": store}
    show({**changed, **estimate.model_dump()}, words, as_json=as_json)


def _estimate(stats: dict[str, Any], believed: MountSection, file: Path) -> SelfCalibration:
    """What the target says that knows the mounting best, once it is known, of a daemon that flies with this file."""
    estimates = [SelfCalibration.model_validate(one) for one in stats.get("selfcal", ())]
    if not estimates:
        raise MkError("the camera has seen no target near enough since the daemon started: fly over one first")
    estimate = min(estimates, key=lambda one: max(one.mounting_sd_deg[:2]))
    worst = max(estimate.mounting_sd_deg[:2])
    if worst > KNOWN_DEG:
        msg = (
            f"the mounting is known to {worst:.1f} deg after {estimate.looks} images, {KNOWN_DEG:g} is needed: turn"
            " (yaw) by 60 deg to both sides over a level target for ten seconds"
        )
        raise MkError(msg)
    if np.abs(np.subtract(believed.rpy_deg, estimate.mount_believed_deg)).max() > SAME_DEG:
        msg = (
            f"camera file {file}: mount.rpy_deg {_words(believed.rpy_deg)}, the daemon flies with"
            f" {_words(estimate.mount_believed_deg)}: give the file its configuration names, restart it after a change,"
            " and leave `mount` out of [[cameras]]"
        )
        raise ConfigError(msg)
    return estimate


def _words(angles: tuple[float, float, float]) -> str:
    return ", ".join(f"{angle:.2f}" for angle in angles)


@app.command
def shutter(
    file: Annotated[Path, Parameter(help="Camera file to write.")],
    pictures: Annotated[Path, Parameter(help="Folder of pictures of a plain wall, without motion.")],
    /,
    *,
    mains: Annotated[Literal["50", "60"], Parameter(help="Frequency of the mains [Hz].")] = "50",
    store: Annotated[bool, Parameter(help="Write it into the camera file.")] = False,
    as_json: AsJson = False,
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
        raise ConfigError(f"{pictures}: pictures of another size than {k.width}x{k.height}, which {file} is for")
    line_time, sd = line_time_of(images, 2.0 * float(mains))
    readout_ms = 1000.0 * line_time * k.height
    if readout_ms > READOUT_MS:
        msg = f"the bands would mean a readout of {readout_ms:.0f} ms: something else moves in the pictures"
        raise VisionError(msg)
    if store:
        changed = k.model_copy(update={"line_time": round(line_time, 9)})
        save_camera(camera.model_copy(update={"intrinsics": changed}), file, overwrite=True)
    before = "none" if k.line_time is None else f"{1e6 * k.line_time:.2f}"
    words = (
        f"line time {1e6 * line_time:.2f} +- {1e6 * sd:.2f} us, readout {readout_ms:.1f} ms; the file has {before}\n"
    )
    words += f"stored in {file}" if store else f"\nnothing written; --store writes it into {file}"
    show({"before": k.line_time, "line_time": line_time, "sd": sd, "stored": store}, words, as_json=as_json)


@app.command(name="import")
def import_camera(
    source: Annotated[Path, Parameter(help="ROS camera_info YAML or ost.txt, or Kalibr's camchain YAML.")],
    file: Annotated[Path, Parameter(help="Camera file to write.")],
    /,
    *,
    force: Annotated[bool, Parameter(help="Overwrite an existing file.")] = False,
) -> None:
    """Make a camera file of another program's calibration; fill in mount and line_time afterwards.

    Such a calibration can also be named wherever a camera file is.

    Example: mkdaemon calibrate import ost.yaml camera.toml

    Raises:
        ConfigError: the source cannot be used, or the file is there already.
    """
    camera = load_camera(source)
    record = CalibrationRecord(board=f"imported from {source.name}")
    save_camera(camera.model_copy(update={"calibration": record}), file, overwrite=force)
    k = camera.intrinsics
    print(f"{k.model} {k.width}x{k.height}, fx {k.fx:g}, fy {k.fy:g} written to {file}")

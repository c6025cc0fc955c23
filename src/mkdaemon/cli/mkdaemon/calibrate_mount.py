"""`mkdaemon calibrate mount`: how a camera sits on the vehicle, as a flight found it, into its camera file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from mkdaemon.cli.printing import json_line
from mkdaemon.client import connect
from mkdaemon.client.connection import DEFAULT_ENDPOINT, DEFAULT_VEHICLE
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.vision.camera.calibration_file import Camera, load_camera, save_camera

KNOWN_DEG: Final = 0.5
"""Deviation of roll and pitch up to which a mounting is stored [deg]."""
SAME_DEG: Final = 0.05
"""Angles that differ by less are the same [deg]."""


async def mount(
    file: Annotated[Path, Parameter(help="Camera file the daemon flies with.")],
    /,
    *,
    camera: Annotated[str | None, Parameter(help="Name of the camera; the only one unless said.")] = None,
    store: Annotated[bool, Parameter(negative=(), help="Write the angles into the camera file.")] = False,
    vehicle: Annotated[str, Parameter(env_var="MK_VEHICLE", help="Name of the vehicle.")] = DEFAULT_VEHICLE,
    connect_to: Annotated[
        str, Parameter(name="--connect", env_var="MK_CONNECT", help="Zenoh endpoint of the daemon.")
    ] = DEFAULT_ENDPOINT,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), help="Answer as one JSON object.")] = False,
) -> None:
    """Compare `mount.rpy_deg` of a camera file with what the running daemon saw in flight, and store it if asked.

    Fly for ten seconds over a level target and turn (yaw) by 60 degrees to both sides: without turning, a camera that
    sits askew and a target that lies askew look the same. The daemon reads the file when it starts.

    Example: mkdaemon calibrate mount flight.mcap --camera down --store

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
    estimate = _best(next(iter(found.values())).fields)
    _check_known(estimate)
    _check_same(before, estimate, file)
    after = before.mount.model_copy(update={"rpy_deg": tuple(round(angle, 2) for angle in estimate.mount_rpy_deg)})
    if store:
        save_camera(before.model_copy(update={"mount": after}), file, overwrite=True)
    if as_json:
        print(
            json_line(
                {"before": before.mount.rpy_deg, "after": after.rpy_deg, "stored": store, **estimate.model_dump()}
            )
        )
        return
    print(f"mount.rpy_deg  file {_words(before.mount.rpy_deg)}  flight {_words(after.rpy_deg)}")
    turn, sd = _words(estimate.mounting_deg), _words(estimate.mounting_sd_deg)
    print(f"turned by {turn} +- {sd} deg, from {estimate.looks} images")
    print(f"stored in {file}; restart the daemon" if store else f"nothing written; --store writes it into {file}")


def _best(stats: dict[str, Any]) -> SelfCalibration:
    """What the target says that knows the mounting best.

    Raises:
        MkError: no target was seen.
    """
    estimates = [SelfCalibration.model_validate(one) for one in stats.get("selfcal", ())]
    if not estimates:
        raise MkError("the camera has seen no target near enough since the daemon started: fly over one first")
    return min(estimates, key=lambda one: max(one.mounting_sd_deg[:2]))


def _check_known(estimate: SelfCalibration) -> None:
    """Refuse what is not known well enough.

    Raises:
        MkError: roll or pitch is known too badly.
    """
    worst = max(estimate.mounting_sd_deg[:2])
    if worst > KNOWN_DEG:
        msg = (
            f"the mounting is known to {worst:.1f} deg after {estimate.looks} images, {KNOWN_DEG:g} is needed: turn"
            " (yaw) by 60 deg to both sides over a level target for ten seconds"
        )
        raise MkError(msg)


def _check_same(camera: Camera, estimate: SelfCalibration, file: Path) -> None:
    """Refuse a file the daemon does not fly with.

    Raises:
        ConfigError: the daemon believes other angles.
    """
    pairs = zip(camera.mount.rpy_deg, estimate.mount_believed_deg, strict=True)
    if any(abs(ours - theirs) > SAME_DEG for ours, theirs in pairs):
        msg = (
            f"camera file {file}: mount.rpy_deg {_words(camera.mount.rpy_deg)}, the daemon flies with"
            f" {_words(estimate.mount_believed_deg)}: give the file its configuration names, restart it after a change,"
            " and leave `mount` out of [[cameras]]"
        )
        raise ConfigError(msg)


def _words(angles: tuple[float, float, float]) -> str:
    return ", ".join(f"{angle:.2f}" for angle in angles)

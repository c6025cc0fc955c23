"""Checks of cameras: the device, its rate, its calibration, and who shares its bus."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from mkdaemon.cli.mkdaemon.doctor.check import Check, Needs, Patient, Severity, Values
from mkdaemon.cli.mkdaemon.doctor.serialline import examined_ports, usb_device
from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError
from mkdaemon.telemetry.vision import EyeState

OLD: Final = 365
"""After this time a lens may sit otherwise, for heat, knocks and a touched focus [days]."""
WORST_RMS_PX: Final = 1.0
"""Reprojection error from which poses are wrong by more than their covariance says [px]."""
WORST_FOCAL_PERCENT: Final = 1.0
"""Standard deviation of the focal length: heights are off by as much [%]."""
SLOW: Final = 0.8
"""Share of the wanted rate that a camera must reach."""
HIGH_SPEED: Final = 480
"""Of a USB 2 bus [Mbit/s]; a camera on a faster one leaves room."""
_DEVICE: Final = re.compile(r"(?:v4l2:)?(/dev/.+)")
_RATE: Final = re.compile(r"\(([0-9.]+) fps\)")


def devices(patient: Patient) -> Iterator[tuple[CameraSection, Path]]:
    """Cameras of the configuration that are devices of this machine."""
    for camera in patient.cfg.cameras:
        if found := _DEVICE.fullmatch(camera.source):
            yield camera, patient.machine.at(found[1])


def _present(patient: Patient) -> Iterator[tuple[CameraSection, Path]]:
    return ((camera, device) for camera, device in devices(patient) if device.exists())


def _missing(patient: Patient) -> Iterator[Values]:
    machine = patient.machine
    there = ", ".join(map(machine.shown, machine.find("dev/video*"))) or "nothing"
    for camera, device in devices(patient):
        if not device.exists():
            yield {"camera": camera.name, "device": machine.shown(device), "there": there}


def _forbidden(patient: Patient) -> Iterator[Values]:
    machine = patient.machine
    for _, device in _present(patient):
        if not machine.may_use(device):
            yield {"device": machine.shown(device), "user": machine.user, "group": machine.group_of(device)}


def _busy(patient: Patient) -> Iterator[Values]:
    machine = patient.machine
    for _, device in _present(patient):
        for holder in machine.holders(device):
            if not holder.is_ours:
                yield {"device": machine.shown(device), "holder": holder, "number": holder.number}


def _without_images(patient: Patient) -> Iterator[Values]:
    machine = patient.machine
    for camera, device in _present(patient):
        index = machine.read(f"/sys/class/video4linux/{device.resolve().name}/index")
        if index not in ("", "0"):
            yield {"camera": camera.name, "device": machine.shown(device)}


def _rate(patient: Patient) -> Iterator[Values]:
    machine = patient.machine
    for camera, device in _present(patient):
        if camera.fps is None:
            continue
        output = machine.run(["v4l2-ctl", "--device", machine.shown(device), "--list-formats-ext"]).out
        rates = [float(rate) for rate in _RATE.findall(_of_size(output, camera))]
        if rates and max(rates) < SLOW * camera.fps:
            yield {
                "camera": camera.name,
                "device": machine.shown(device),
                "wanted": f"{camera.fps:g}",
                "best": f"{max(rates):g}",
            }


def _of_size(output: str, camera: CameraSection) -> str:
    """What v4l2-ctl says of the wanted size; of all sizes where none is wanted, or it is not among them."""
    size = f"{camera.width}x{camera.height}"
    parts = [part for part in re.split(r"Size: ", output) if part.startswith(f"Discrete {size}\n")]
    return "".join(parts) or output


def _slow(patient: Patient) -> Iterator[Values]:
    wanted = {camera.name: camera.fps for camera in patient.cfg.cameras if camera.fps is not None}
    for eye in patient.report.eyes:
        rate = wanted.get(eye.camera)
        if rate is not None and eye.state is EyeState.OK and eye.fps < SLOW * rate:
            yield {"camera": eye.camera, "fps": f"{eye.fps:.0f}", "wanted": f"{rate:g}"}


def _unfit(patient: Patient) -> Iterator[Values]:
    for eye in patient.report.eyes:
        if eye.state is not EyeState.OK:
            yield {"camera": eye.camera, "state": eye.state, "reason": eye.reason}


def _uncalibrated(patient: Patient) -> Iterator[Values]:
    for camera in patient.cfg.cameras:
        if camera.calibration is None:
            yield {"camera": camera.name}


def _calibrations(patient: Patient) -> Iterator[tuple[CameraSection, Any]]:
    """Cameras and their camera files, of those that can be read; the others are mistakes of the configuration."""
    with suppress(ConfigError, ImportError):
        from mkdaemon.vision.camera.calibration_file import load_camera

        for camera in patient.cfg.cameras:
            if camera.calibration is not None:
                with suppress(ConfigError):
                    yield camera, load_camera(camera.calibration)


def _poor(patient: Patient) -> Iterator[Values]:
    for camera, found in _calibrations(patient):
        record = found.calibration
        if record.forced:
            reason = "it was stored although it is poor"
        elif record.rms_px > WORST_RMS_PX:
            reason = f"its error is {record.rms_px:g} px"
        elif record.focal_sd_percent > WORST_FOCAL_PERCENT:
            reason = f"its focal length is known to {record.focal_sd_percent:g} %"
        else:
            continue
        yield {"camera": camera.name, "file": camera.calibration, "reason": reason}


def _old(patient: Patient) -> Iterator[Values]:
    for camera, found in _calibrations(patient):
        with suppress(ValueError):
            made = datetime.fromisoformat(found.calibration.date).replace(tzinfo=UTC).timestamp()
            days = (patient.machine.wall() - made) / 86400
            if days > OLD:
                yield {"camera": camera.name, "file": camera.calibration, "days": f"{days:.0f}"}


def _other_shape(patient: Patient) -> Iterator[Values]:
    for camera, found in _calibrations(patient):
        lens = found.intrinsics
        if camera.width and camera.height and camera.width * lens.height != camera.height * lens.width:
            yield {
                "camera": camera.name,
                "file": camera.calibration,
                "calibrated": f"{lens.width}x{lens.height}",
                "wanted": f"{camera.width}x{camera.height}",
            }


def _shared_bus(patient: Patient) -> Iterator[Values]:
    machine = patient.machine
    for camera, device in _present(patient):
        eye = usb_device(machine.at(f"/sys/class/video4linux/{device.resolve().name}/device"))
        for port in examined_ports(patient):
            adapter = usb_device(machine.at(f"/sys/class/tty/{port.resolve().name}/device"))
            if eye is None or adapter is None or machine.read(eye / "busnum") != machine.read(adapter / "busnum"):
                continue
            speed = machine.read(eye / "speed")
            if speed.isdigit() and int(speed) <= HIGH_SPEED:
                bus = machine.read(eye / "busnum")
                yield {"camera": camera.name, "port": machine.shown(port), "bus": bus, "speed": speed}


CAMERAS: Final = (
    Check(
        "camera-missing",
        Severity.ERROR,
        what="camera {camera}: {device} does not exist",
        why="No flight against a target begins.",
        fix="Plug it in, or correct its source; there is {there}.",
        command="v4l2-ctl --list-devices",
        look=_missing,
        needs=Needs.CONFIG,
    ),
    Check(
        "camera-forbidden",
        Severity.ERROR,
        what="{device} may not be opened by {user}",
        why="Only members of its group may open a camera.",
        fix="Join the group, then log in again.",
        command="sudo usermod -aG {group} {user}",
        look=_forbidden,
        needs=Needs.CONFIG,
    ),
    Check(
        "camera-busy",
        Severity.ERROR,
        what="{device} is in use by {holder}",
        why="A camera gives its images to one program.",
        fix="End that program.",
        command="kill {number}",
        look=_busy,
        needs=Needs.CONFIG,
    ),
    Check(
        "camera-node",
        Severity.ERROR,
        what="camera {camera}: {device} gives no images",
        why="A camera has several devices, and only the first of them has images.",
        fix="Name its first device.",
        command="v4l2-ctl --list-devices",
        look=_without_images,
        needs=Needs.CONFIG,
    ),
    Check(
        "camera-rate",
        Severity.WARNING,
        what="camera {camera} is asked for {wanted} images a second, and gives {best} at most",
        why="Fewer images hold the aircraft less steadily.",
        fix="Ask for what it can, or for smaller images; MJPG is faster than raw images.",
        command="v4l2-ctl --device {device} --list-formats-ext",
        look=_rate,
        needs=Needs.CONFIG,
    ),
    Check(
        "camera-slow",
        Severity.WARNING,
        what="camera {camera} gives {fps} images a second, and {wanted} are wanted",
        why="It is dark and the camera exposes for long, its cable is slow, or another device takes the USB bus.",
        fix="Add light, set exposure_ms, use another USB port.",
        command="mkctl watch 'vision/*/stats'",
        look=_slow,
        needs=Needs.DAEMON,
    ),
    Check(
        "camera-state",
        Severity.ERROR,
        what="camera {camera} is {state}",
        why="{reason}",
        fix="As it says; docs/cameras.md.",
        command="mkctl watch 'vision/*/stats'",
        look=_unfit,
        needs=Needs.DAEMON,
    ),
    Check(
        "calibration-none",
        Severity.WARNING,
        what="camera {camera} has no calibration",
        why="Its tags are published, poses never.",
        fix="Calibrate it, and name the file as its calibration.",
        command="mkdaemon calibrate camera --help",
        look=_uncalibrated,
        needs=Needs.CONFIG,
    ),
    Check(
        "calibration-poor",
        Severity.WARNING,
        what="the calibration {file} of camera {camera} is poor: {reason}",
        why="Heights and distances are off by as much as the focal length.",
        fix="Calibrate again, with views turned to every side.",
        command="mkdaemon calibrate camera --help",
        look=_poor,
        needs=Needs.CONFIG,
    ),
    Check(
        "calibration-old",
        Severity.ADVICE,
        what="the calibration {file} of camera {camera} is {days} days old",
        why="Knocks, heat and a touched focus change a lens.",
        fix="Compare it with a measured distance, or calibrate again.",
        command="mkdaemon calibrate camera --help",
        look=_old,
        needs=Needs.CONFIG,
    ),
    Check(
        "calibration-size",
        Severity.ERROR,
        what="camera {camera} is asked for {wanted}, and {file} was made for {calibrated}",
        why="An image of another shape shows another part of the sensor: its calibration does not hold.",
        fix="Ask for a size of that shape, or calibrate at the other one.",
        command="mkdaemon calibrate camera --help",
        look=_other_shape,
        needs=Needs.CONFIG,
    ),
    Check(
        "usb-shared",
        Severity.WARNING,
        what="camera {camera} and {port} share USB bus {bus} of {speed} Mbit/s",
        why="Images take most of it, and bytes of the line come late or are lost.",
        fix="Plug one of them into a port of another bus.",
        command="lsusb -t",
        look=_shared_bus,
        needs=Needs.CONFIG,
    ),
)
"""Checks of cameras."""

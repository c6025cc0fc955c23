"""Checks of cameras: the device, its rate, its calibration, and other devices on its USB bus."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from mkdaemon.cli.mkdaemon.doctor.check import CheckPart, Needs, Patient, Severity, Values
from mkdaemon.cli.mkdaemon.doctor.serialline import examined_ports, usb_device
from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError
from mkdaemon.telemetry.vision import EyeState

CAMERAS: Final = CheckPart("Cameras")

OLD: Final = 365
"""Age from which a calibration may be wrong: heat, knocks and a touched focus move a lens [days]."""
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


def _of_size(output: str, camera: CameraSection) -> str:
    """What v4l2-ctl says of the wanted size; of all sizes where none is wanted, or it is not among them."""
    size = f"{camera.width}x{camera.height}"
    parts = [part for part in re.split(r"Size: ", output) if part.startswith(f"Discrete {size}\n")]
    return "".join(parts) or output


def _calibrations(patient: Patient) -> Iterator[tuple[CameraSection, Any]]:
    """Cameras and their camera files, of those that can be read; the others are mistakes of the configuration."""
    with suppress(ConfigError, ImportError):
        from mkdaemon.vision.camera.calibration_file import load_camera

        for camera in patient.cfg.cameras:
            if camera.calibration is not None:
                with suppress(ConfigError):
                    yield camera, load_camera(camera.calibration)


@CAMERAS("camera-missing", Severity.ERROR, Needs.CONFIG)
def _missing(patient: Patient) -> Iterator[Values]:
    """camera {camera}: {device} does not exist

    The daemon refuses flights against a target.

    Plug it in, or correct its source. Devices of this machine: {there}.

    $ v4l2-ctl --list-devices
    """
    machine = patient.machine
    there = ", ".join(map(machine.shown, machine.find("dev/video*"))) or "nothing"
    for camera, device in devices(patient):
        if not device.exists():
            yield {"camera": camera.name, "device": machine.shown(device), "there": there}


@CAMERAS("camera-forbidden", Severity.ERROR, Needs.CONFIG)
def _forbidden(patient: Patient) -> Iterator[Values]:
    """{user} may not open {device}

    Only members of its group may open a camera.

    Join the group, then log in again.

    $ sudo usermod -aG {group} {user}
    """
    machine = patient.machine
    for _, device in _present(patient):
        if not machine.may_use(device):
            yield {"device": machine.shown(device), "user": machine.user, "group": machine.group_of(device)}


@CAMERAS("camera-busy", Severity.ERROR, Needs.CONFIG)
def _busy(patient: Patient) -> Iterator[Values]:
    """{device} is in use by {holder}

    Only one program can use a camera.

    End that program.

    $ kill {number}
    """
    machine = patient.machine
    for _, device in _present(patient):
        for holder in machine.holders(device):
            if not holder.is_ours:
                yield {"device": machine.shown(device), "holder": holder, "number": holder.number}


@CAMERAS("camera-node", Severity.ERROR, Needs.CONFIG)
def _without_images(patient: Patient) -> Iterator[Values]:
    """camera {camera}: {device} delivers no images

    A camera has several devices, and only the first one delivers images.

    Set its source to the first device.

    $ v4l2-ctl --list-devices
    """
    machine = patient.machine
    for camera, device in _present(patient):
        index = machine.read(f"/sys/class/video4linux/{device.resolve().name}/index")
        if index not in ("", "0"):
            yield {"camera": camera.name, "device": machine.shown(device)}


@CAMERAS("camera-rate", Severity.WARNING, Needs.CONFIG)
def _rate(patient: Patient) -> Iterator[Values]:
    """camera {camera} is set to {wanted} images a second, but delivers at most {best}

    With fewer images, the aircraft holds its position less accurately.

    Reduce fps, or use smaller images; MJPG is faster than raw images.

    $ v4l2-ctl --device {device} --list-formats-ext
    """
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


@CAMERAS("camera-slow", Severity.WARNING, Needs.DAEMON)
def _slow(patient: Patient) -> Iterator[Values]:
    """camera {camera} delivers {fps} images a second instead of {wanted}

    Long exposure in the dark, a slow cable, or another device on the USB bus.

    Add light, set exposure_ms, or use another USB port.

    $ mkctl watch 'vision/*/stats'
    """
    wanted = {camera.name: camera.fps for camera in patient.cfg.cameras if camera.fps is not None}
    for eye in patient.report.eyes:
        rate = wanted.get(eye.camera)
        if rate is not None and eye.state is EyeState.OK and eye.fps < SLOW * rate:
            yield {"camera": eye.camera, "fps": f"{eye.fps:.0f}", "wanted": f"{rate:g}"}


@CAMERAS("camera-state", Severity.ERROR, Needs.DAEMON)
def _unfit(patient: Patient) -> Iterator[Values]:
    """camera {camera} is {state}

    {reason}

    See docs/cameras.md.

    $ mkctl watch 'vision/*/stats'
    """
    for eye in patient.report.eyes:
        if eye.state is not EyeState.OK:
            yield {"camera": eye.camera, "state": eye.state, "reason": eye.reason}


@CAMERAS("calibration-none", Severity.WARNING, Needs.CONFIG)
def _uncalibrated(patient: Patient) -> Iterator[Values]:
    """camera {camera} has no calibration

    The daemon publishes its tags, but no poses.

    Calibrate it, and set `calibration` to the file.

    $ mkdaemon calibrate camera --help
    """
    for camera in patient.cfg.cameras:
        if camera.calibration is None:
            yield {"camera": camera.name}


@CAMERAS("calibration-poor", Severity.WARNING, Needs.CONFIG)
def _poor(patient: Patient) -> Iterator[Values]:
    """the calibration {file} of camera {camera} is poor: {reason}

    Heights and distances have the same relative error as the focal length.

    Calibrate again, with views tilted to every side.

    $ mkdaemon calibrate camera --help
    """
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


@CAMERAS("calibration-old", Severity.ADVICE, Needs.CONFIG)
def _old(patient: Patient) -> Iterator[Values]:
    """the calibration {file} of camera {camera} is {days} days old

    Knocks, heat and a touched focus change the calibration.

    Compare it with a measured distance, or calibrate again.

    $ mkdaemon calibrate camera --help
    """
    for camera, found in _calibrations(patient):
        with suppress(ValueError):
            made = datetime.fromisoformat(found.calibration.date).replace(tzinfo=UTC).timestamp()
            days = (patient.machine.wall() - made) / 86400
            if days > OLD:
                yield {"camera": camera.name, "file": camera.calibration, "days": f"{days:.0f}"}


@CAMERAS("calibration-size", Severity.ERROR, Needs.CONFIG)
def _other_shape(patient: Patient) -> Iterator[Values]:
    """camera {camera} is set to {wanted}, but {file} was made for {calibrated}

    An image with another aspect ratio shows another part of the sensor: the calibration does not apply.

    Use a size with that aspect ratio, or calibrate again.

    $ mkdaemon calibrate camera --help
    """
    for camera, found in _calibrations(patient):
        lens = found.intrinsics
        if camera.width and camera.height and camera.width * lens.height != camera.height * lens.width:
            yield {
                "camera": camera.name,
                "file": camera.calibration,
                "calibrated": f"{lens.width}x{lens.height}",
                "wanted": f"{camera.width}x{camera.height}",
            }


@CAMERAS("usb-shared", Severity.WARNING, Needs.CONFIG)
def _shared_bus(patient: Patient) -> Iterator[Values]:
    """camera {camera} and {port} share USB bus {bus} of {speed} Mbit/s

    Images use most of the bus, so serial bytes are late or lost.

    Move one of them to a port of another bus.

    $ lsusb -t
    """
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

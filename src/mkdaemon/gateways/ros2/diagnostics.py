"""How the vehicle and its parts are, as ROS diagnostics: the picture's own words and levels."""

from __future__ import annotations

from typing import Any

from mkdaemon.gateways.ros2.messages import ConversionScene, header, key_value
from mkdaemon.reading import Picture, Reading
from mkdaemon.reading.diagnoses import Diagnosis, diagnoses_of
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlStatus


def report(scene: ConversionScene, now: Stamp, gateway: Diagnosis | None = None) -> Any:
    """DiagnosticArray of everything.

    Args:
        scene: with the newest values.
        now: the present moment, on the clocks of the values' stamps where they are of this machine.
        gateway: how the gateway itself is; None in a bag, which has none.
    """
    found = [*diagnoses_of(picture_of(scene, now)), *([] if gateway is None else [gateway])]
    status = [status_of(scene, diagnosis) for diagnosis in found]
    return scene.types.new("diagnostic_msgs/msg/DiagnosticArray", header=header(scene.types, now, ""), status=status)


def picture_of(scene: ConversionScene, now: Stamp) -> Picture:
    """What the newest values mean together."""
    reading = Reading()
    for suffix, value in scene.latest.items():
        if isinstance(value, Stamped):
            reading.take(suffix, value, -_age(value.stamp, now))
    return reading.at(0.0)


def _age(stamp: Stamp, now: Stamp) -> float:
    """By the monotonic clock where it is the same one, else by the wall clock [s]."""
    return now.monotonic - stamp.monotonic if now.boot == stamp.boot else now.wall - stamp.wall


def status_of(scene: ConversionScene, diagnosis: Diagnosis) -> Any:
    """DiagnosticStatus of one thing."""
    types = scene.types
    return types.new(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=types.octet(diagnosis.level),
        name=f"{scene.vehicle}: {diagnosis.name}",
        message=diagnosis.message,
        hardware_id=scene.vehicle,
        values=[key_value(types, key, value) for key, value in diagnosis.values.items()],
    )


def control_status(value: ControlStatus, scene: ConversionScene) -> Any:
    """DiagnosticStatus of the holder and the manoeuvre: the topic `status`."""
    reading = Reading()
    reading.take("control/status", value, 0.0)
    found = {diagnosis.name: diagnosis for diagnosis in diagnoses_of(reading.at(0.0))}
    return status_of(scene, found["control"])

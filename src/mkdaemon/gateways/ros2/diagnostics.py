"""How aircraft, line, battery, eyes and lease are, as ROS diagnostics, in the daemon's own words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from mkdaemon.gateways.ros2.messages import Scene, header, key_value
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlStatus, Tone
from mkdaemon.telemetry.link import LinkCondition, LinkHealth
from mkdaemon.telemetry.state import Battery
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import EyeState, VisionStats


class Level(IntEnum):
    """Severities of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One thing that was looked at.

    Attributes:
        level: how bad it is.
        message: why, in the daemon's words.
        values: numbers beside it.
    """

    level: Level
    message: str
    values: Mapping[str, object]


def of_health(value: VehicleHealth) -> Diagnosis:
    """The vehicle's signs of life."""
    level = Level.ERROR if not value.is_alive or value.error else Level.WARN if value.read_only else Level.OK
    values = {
        "boards": ", ".join(value.boards),
        "firmware": ", ".join(f"{board} {release}" for board, release in value.firmware.items()),
        "motors_running": value.motors_running,
        "read_only": value.read_only,
    }
    return Diagnosis(level, value.error or value.read_only or value.reason, values)


def of_link(value: LinkHealth) -> Diagnosis:
    """The serial line."""
    condition = value.state.condition
    level = {LinkCondition.UP: Level.OK, LinkCondition.DEGRADED: Level.WARN}.get(condition, Level.ERROR)
    values = {
        "condition": condition.value,
        "port": value.state.port,
        "echo_p50_ms": value.echo.p50_ms,
        "echo_p99_ms": value.echo.p99_ms,
        "echo_loss_percent": value.echo.loss_percent,
        "confirm_p99_ms": value.confirm.p99_ms,
        "confirm_loss_percent": value.confirm.loss_percent,
        **{
            f"{name}_{count}": number
            for name in ("link_tests", "requests", "stick_frames")
            for count, number in getattr(value, name).model_dump().items()
        },
        "checksum_errors_per_s": value.checksum_error_rate,
        "garbage_bytes_per_s": value.garbage_bytes_per_s,
    } | {f"{kind.board}.{kind.key}_hz": kind.rate for kind in value.kinds}
    return Diagnosis(level, f"{condition.value}: {value.state.reason}", values)


def of_battery(value: Battery) -> Diagnosis:
    """The battery."""
    level = Level.ERROR if value.is_low else Level.OK
    words = "the board says that it is low" if value.is_low else f"{value.voltage:.1f} V"
    return Diagnosis(level, words, {"voltage": value.voltage, "current": value.current, "used_mah": value.used_mah})


def of_lease(value: ControlStatus) -> Diagnosis:
    """Who flies."""
    is_well = value.phase.tone in (Tone.NOTE, Tone.OK) and value.pilots_throttle is None
    level = Level.ERROR if value.trouble else Level.OK if is_well else Level.WARN
    values = {
        "trouble": value.trouble,
        "releases_in": value.releases_in,
        "phase": value.phase.value,
        "holder": None if value.lease is None else value.lease.holder,
        "manoeuvre": value.manoeuvre,
        "stage": value.stage,
        "is_done": value.is_done,
        "outcome": None if value.outcome is None else value.outcome.value,
        "hands": value.hands,
        "setpoint_age": value.setpoint_age,
        "refused": value.refused,
    }
    return Diagnosis(level, value.trouble or value.reason, values)


def of_eyes(value: VisionStats) -> Diagnosis:
    """A camera and what looks through it."""
    alarms = "; ".join(value.alarms.values())
    level = Level.ERROR if value.state is not EyeState.OK else Level.WARN if alarms else Level.OK
    values = {
        "state": value.state.value,
        "fps": value.fps,
        "posed": value.posed,
        "lost": value.lost,
        "damaged": value.damaged,
        "latency_p50_ms": value.latency_p50_ms,
        "latency_p99_ms": value.latency_p99_ms,
    } | {f"refused.{reason}": count for reason, count in value.refused.items()}
    return Diagnosis(level, value.reason or alarms or "poses come when a target is in sight", values)


@dataclass(frozen=True, slots=True)
class Look:
    """One row of the report.

    Attributes:
        name: of the diagnosis.
        key: whose newest value is looked at; a `*` stands for every camera.
        diagnose: what it means.
        fresh_for: an older value is stale [s].
    """

    name: str
    key: str
    diagnose: Callable[[Any], Diagnosis]
    fresh_for: float


LOOKS: Final = (
    Look("vehicle", "health", of_health, 3.0),
    Look("link", "link/health", of_link, 2.0),
    Look("battery", "state/battery", of_battery, 5.0),
    Look("lease", "control/status", of_lease, 3.0),
    Look("eyes", "vision/*/stats", of_eyes, 3.0),
)
"""Everything that is diagnosed; a further thing is one row."""


def report(scene: Scene, now: Stamp, gateway: Diagnosis | None = None) -> Any:
    """DiagnosticArray of everything.

    Args:
        scene: with the newest values.
        now: the present moment, on the clocks of the values' stamps where they are of this machine.
        gateway: how the gateway itself is; None in a bag, which has none.
    """
    found = [(look.name, stale_or(look, value, now)) for look in LOOKS for value in _values(scene, look)]
    if gateway is not None:
        found.append(("gateway", gateway))
    status = [status_of(scene, name, diagnosis) for name, diagnosis in found]
    return scene.types.new("diagnostic_msgs/msg/DiagnosticArray", header=header(scene.types, now, ""), status=status)


def _values(scene: Scene, look: Look) -> Iterator[Stamped | None]:
    if "*" not in look.key:
        yield scene.latest.get(look.key)
        return
    before, _, after = look.key.partition("*")
    for suffix in sorted(scene.latest):
        if suffix.startswith(before) and suffix.endswith(after):
            yield scene.latest[suffix]


def stale_or(look: Look, value: Stamped | None, now: Stamp) -> Diagnosis:
    """What a value says, or that it says nothing any more."""
    if value is None:
        return Diagnosis(Level.STALE, f"nothing was heard of {look.key} yet", {})
    age = now.monotonic - value.stamp.monotonic if now.boot == value.stamp.boot else now.wall - value.stamp.wall
    if age > look.fresh_for:
        return Diagnosis(Level.STALE, f"{look.key} is {age:.1f} s old: is the daemon there?", {"age": age})
    return look.diagnose(value)


def status_of(scene: Scene, name: str, diagnosis: Diagnosis) -> Any:
    """DiagnosticStatus of one thing."""
    types = scene.types
    return types.new(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=types.octet(diagnosis.level),
        name=f"{scene.vehicle}: {name}",
        message=diagnosis.message,
        hardware_id=scene.vehicle,
        values=[key_value(types, key, value) for key, value in diagnosis.values.items()],
    )


def lease_status(value: ControlStatus, scene: Scene) -> Any:
    """DiagnosticStatus of who flies and what: the topic `status`."""
    return status_of(scene, "lease", of_lease(value))

"""A known flight for the page: an aircraft over its target, one value of every key that is shown."""

from __future__ import annotations

from typing import Any

from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import (
    ControlError,
    ControlEstimate,
    ControlFence,
    ControlOutput,
    ControlStatus,
    LeaseState,
    Phase,
)
from mkdaemon.telemetry.event import CommandEvent
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.link import Fates, LinkCondition, LinkHealth, LinkState, RoundTripStats
from mkdaemon.telemetry.state import Altitude, Attitude, Battery
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import CameraSetup, LensShape, Tags, TagShape, TagSighting, TargetShape, VisionPose
from tests.values import made

LENS = LensShape(width=640, height=480, fx=400.0, fy=400.0, cx=319.5, cy=239.5, model="pinhole", distortion=(0.0,) * 5)
DOWN = (0.0, 0.7071067811865476, -0.7071067811865476, 0.0)
"""Body from a camera that looks down, the top of its image forward."""
SQUARE = ((-0.15, 0.15, 0.0), (0.15, 0.15, 0.0), (0.15, -0.15, 0.0), (-0.15, -0.15, 0.0))
BATTERY = {"voltage": 14.8, "current": 12.5, "used_mah": 430.0, "is_low": False}


def stamp(at: float, boot: str = "a") -> Stamp:
    return Stamp(monotonic=at, wall=1.7e9 + at, boot=boot)


def status(at: float, **change: Any) -> ControlStatus:
    lease = LeaseState(holder="anna", epoch=7, ttl=1.0, left=0.9)
    fields = {"phase": Phase.FLYING, "reason": "anna flies", "lease": lease, "manoeuvre": "position"}
    fields |= {"external_control": "12", "hands": "keeps his thumbs on centred sticks"}
    return made(ControlStatus, stamp(at), **fields | change)


def estimate(at: float, position: tuple[float, float, float] = (0.12, -0.05, 2.01), **change: Any) -> ControlEstimate:
    fields = {"target": "pad", "yaw": 0.5, "hover_throttle": 90.0, "position_sd": (0.02, 0.02, 0.01), "image_age": 0.05}
    fields |= {"covariance": ((0.0004, 0.0, 0.0), (0.0004, 0.0, 0.0), (0.0001, 0.0, 0.0))}
    return made(ControlEstimate, stamp(at), position=position, **fields | change)


def pose(at: float, position: tuple[float, float, float] = (0.0, 0.0, 2.0), sequence: int = 1) -> VisionPose:
    covariance = [0.0] * 36
    covariance[0], covariance[7], covariance[14] = 0.0004, 0.0001, 0.0001
    seen = {"position_cam": (0.0, 0.0, position[2]), "quaternion_cam_from_target": (0.0, 1.0, 0.0, 0.0)}
    seen |= {"camera": "down", "target": "pad", "covariance": tuple(covariance)}
    return made(VisionPose, stamp(at), sequence=sequence, position_target=position, **seen)


def setup(at: float, **change: Any) -> CameraSetup:
    shape = TargetShape(
        name="pad", moving=False, tags=(TagShape(family="tag36h11", id=48, corners=SQUARE, cells=("##", "#.")),)
    )
    fields = {"lens": LENS, "position_flu": (0.0, 0.0, 0.0), "quaternion_flu_from_cam": DOWN, "targets": (shape,)}
    return CameraSetup(stamp=stamp(at), camera="down", **(fields | change))


def link_state(at: float, condition: LinkCondition = LinkCondition.UP) -> LinkState:
    return made(LinkState, stamp(at), condition=condition, reason="both directions proven", port="/dev/ttyUSB0")


def link_health(at: float) -> LinkHealth:
    echo = RoundTripStats(sent=50, lost=1, loss_percent=2.0, last_ms=21.0, p50_ms=20.0, p95_ms=30.0, p99_ms=44.0)
    tests = Fates(sent=50, answered=49, unanswered=1, lost=1)
    return made(LinkHealth, stamp(at), state=link_state(at), echo=echo, link_tests=tests)


def tags(at: float, sequence: int) -> Tags:
    corners = ((200.0, 100.0), (300.0, 100.0), (300.0, 200.0), (200.0, 200.0))
    sighting = made(TagSighting, family="tag36h11", id=48, corners=corners, search="roi")
    return made(Tags, stamp(at), camera="down", sequence=sequence, tags=(sighting,))


def image(at: float, sequence: int) -> CameraFrame:
    size = {"width": 4, "height": 3, "coding": "gray8", "pixels": bytes(range(12))}
    return made(CameraFrame, stamp(at), camera="down", sequence=sequence, **size)


def hovering(at: float) -> list[tuple[str, Any]]:
    """Everything that is said while an aircraft hovers over its target."""
    return [
        ("health", alive(at)),
        ("control/status", status(at)),
        ("control/fence", ControlFence(stamp=stamp(at), radius=5.0, height=6.0, floor=0.3)),
        ("control/estimate", estimate(at)),
        ("control/error", error(at)),
        ("control/output", output(at)),
        ("state/attitude", attitude(at)),
        ("state/altitude", Altitude(stamp=stamp(at), source="fc", above_start=1.9)),
        ("state/battery", battery(at)),
        ("link/state", link_state(at)),
        ("link/health", link_health(at)),
        ("vision/down/setup", setup(at)),
        ("vision/down/pose", pose(at - 0.1)),
    ]


def alive(at: float, **change: Any) -> VehicleHealth:
    fields = {"is_alive": True, "boards": ("fc",), "firmware": {"fc": "2.12a"}, "link": "up", "battery_cells": 4}
    return made(VehicleHealth, stamp(at), **fields | {"motors_running": True} | change)


def error(at: float) -> ControlError:
    off = (-0.03, 0.04, 0.01)
    return made(ControlError, stamp(at), manoeuvre="position", goal=(0.15, -0.09, 2.0), error_pad=off, error_body=off)


def output(at: float) -> ControlOutput:
    sticks = {"pitch": 10, "roll": -5, "throttle": 3, "limited": True, "wanted": (30.0, -5.0, 0.0, 3.0)}
    return made(ControlOutput, stamp(at), epoch=7, **sticks)


def battery(at: float, **change: Any) -> Battery:
    return made(Battery, stamp(at), **BATTERY | change)


def attitude(at: float, roll: float = 0.1) -> Attitude:
    return made(Attitude, stamp(at), source="fc", roll=roll, pitch=-0.05)


def refusal(at: float) -> CommandEvent:
    words = {"token": "no_target", "reason": "no target is in sight.", "fix": "Put the print below the camera."}
    return made(CommandEvent, stamp(at), key="setpoint/takeoff", status="denied", **words)

"""A sample of every value that a daemon publishes: an aircraft that hovers over its target, as short as can be."""

from __future__ import annotations

from functools import partial
from typing import Any

from mkdaemon.bus.keys import KEYS, Use
from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
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
from mkdaemon.telemetry.event import CommandEvent, FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.link import Fates, LinkCondition, LinkHealth, LinkState, RoundTripStats
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.state import Altitude, Attitude, Battery, Gps, Pilot, Position, Velocity
from mkdaemon.telemetry.traffic import RawFrame
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import (
    CameraSetup,
    EyeState,
    LensShape,
    Tags,
    TagShape,
    TagSighting,
    TargetShape,
    Transform,
    VisionPose,
    VisionStats,
)
from tests.values import made

AT = 100.5
"""Time of a sample where none is given [s]."""
LENS = LensShape(width=640, height=480, fx=400.0, fy=400.0, cx=319.5, cy=239.5, model="pinhole", distortion=(0.0,) * 5)
DOWN = (0.0, 0.7071067811865476, -0.7071067811865476, 0.0)
"""Body from a camera that looks down, the top of its image forward."""
SQUARE = ((-0.15, 0.15, 0.0), (0.15, 0.15, 0.0), (0.15, -0.15, 0.0), (-0.15, -0.15, 0.0))
PAD = TargetShape(
    name="pad", moving=False, tags=(TagShape(family="tag36h11", id=48, corners=SQUARE, cells=("##", "#.")),)
)
CORNERS = ((200.0, 100.0), (300.0, 100.0), (300.0, 200.0), (200.0, 200.0))
"""Top-left, top-right, bottom-right, bottom-left of its tag in the image [px]."""
SPREAD = (0.0004, 0.0001, 0.0001)
"""Variances of a pose [m2]."""


def stamp(at: float = AT, boot: str = "a") -> Stamp:
    return Stamp(monotonic=at, wall=1.7e9 + at, boot=boot)


FIELDS: dict[type, dict[str, Any]] = {
    VehicleHealth: {
        "is_alive": True, "boards": ("fc",), "firmware": {"fc": "2.12a"}, "link": "up", "battery_cells": 4,
        "motors_running": True,
    },
    ControlStatus: {
        "phase": Phase.FLYING, "reason": "anna flies", "lease": LeaseState(holder="anna", epoch=7, ttl=1.0, left=0.9),
        "manoeuvre": "position", "external_control": "12", "hands": "keeps his thumbs on centred sticks",
    },
    ControlFence: {"radius": 5.0, "height": 6.0, "floor": 0.3},
    ControlEstimate: {
        "target": "pad", "position": (0.12, -0.05, 2.01), "yaw": 0.5, "hover_throttle": 90.0, "image_age": 0.05,
        "position_sd": (0.02, 0.02, 0.01), "covariance": ((0.0004, 0.0, 0.0), (0.0004, 0.0, 0.0), (0.0001, 0.0, 0.0)),
    },
    ControlError: {
        "manoeuvre": "position", "goal": (0.15, -0.09, 2.0), "error_pad": (-0.03, 0.04, 0.01),
        "error_body": (-0.03, 0.04, 0.01),
    },
    ControlOutput: {
        "epoch": 7, "pitch": 10, "roll": -5, "throttle": 3, "limited": True, "wanted": (30.0, -5.0, 0.0, 3.0),
    },
    Attitude: {"source": "fc", "roll": 0.1, "pitch": -0.05},
    Altitude: {"source": "fc", "above_start": 1.9},
    Battery: {"voltage": 15.5, "current": 12.5, "used_mah": 430.0, "is_low": False},
    Gps: {"satellites": 9, "fix": "valid", "is_usable": True, "is_home_set": True},
    Position: {
        "latitude_deg": 53.2301184, "longitude_deg": 7.4590749, "altitude": 12.5, "altitude_above_start": 3.0,
        "position_enu": (1.0, 2.0, 3.0), "home_latitude_deg": 53.23, "home_longitude_deg": 7.459, "home_distance": 2.2,
    },
    Velocity: {"velocity_enu": (1.0, 2.0, -0.5), "ground_speed": 2.24, "course": 0.4, "climb_rate": -0.5},
    Pilot: {"rc_quality": 0.9, "has_signal": True, "throttle": 12.0, "sticks": (10.0, 20.0, 30.0)},
    LinkState: {"condition": LinkCondition.UP, "reason": "both directions proven", "port": "/dev/ttyUSB0"},
    LinkHealth: {
        "echo": RoundTripStats(sent=50, lost=1, loss_percent=2.0, last_ms=21.0, p50_ms=20.0, p95_ms=30.0, p99_ms=44.0),
        "link_tests": Fates(sent=50, answered=49, unanswered=1, lost=1),
    },
    RecordStatus: {"state": RecorderState.RECORDING},
    CameraSetup: {
        "camera": "down", "lens": LENS, "position_flu": (0.0, 0.0, 0.0), "quaternion_flu_from_cam": DOWN,
        "targets": (PAD,),
    },
    CameraFrame: {"camera": "down", "width": 4, "height": 3, "coding": "gray8", "pixels": bytes(range(12))},
    TagSighting: {
        "family": "tag36h11", "id": 48, "corners": CORNERS, "search": "roi", "hamming": 1, "decision_margin": 40.0,
    },
    VisionPose: {
        "camera": "down", "target": "pad", "sequence": 1, "position_target": (0.0, 0.0, 2.0),
        "position_cam": (0.0, 0.0, 2.0), "quaternion_cam_from_target": (0.0, 1.0, 0.0, 0.0),
        "covariance": tuple(SPREAD[row] if row == column < 3 else 0.0 for row in range(6) for column in range(6)),
    },
    VisionStats: {"camera": "down", "state": EyeState.OK, "fps": 30.0, "posed": 0.9},
    Transform: {
        "parent": "body", "child": "camera/down", "static": True, "translation": (0.1, 0.0, -0.05),
        "quaternion": (0.0, 1.0, 0.0, 0.0),
    },
    RawFrame: {"sequence": 7, "raw": b"#bb?li=S]A>====NX\r"},
    CommandEvent: {
        "key": "setpoint/takeoff", "status": "denied", "token": "no_target", "reason": "no target is in sight.",
        "fix": "Put the print below the camera.",
    },
    LogEvent: {"level": "info", "text": "look"},
    FailsafeEvent: {"action": "release", "reason": "why"},
    ModeEvent: {"before": "free", "after": "leased", "reason": "why"},
}  # fmt: skip
"""What is to be seen in each value."""


def sample(kind: type, at: float = AT, **change: Any) -> Any:
    """A value of a class of this time [s], with changes."""
    fields = FIELDS[kind] | change
    if kind is Attitude and "quaternion" not in fields:
        turned = rotation_from_euler(fields["roll"], fields["pitch"], fields.get("yaw", 0.0))
        fields["quaternion"] = tuple(quaternion_from_rotation(turned))
    return made(kind, stamp(at), **fields)


alive, status, fence = (partial(sample, kind) for kind in (VehicleHealth, ControlStatus, ControlFence))
estimate, error, output = (partial(sample, kind) for kind in (ControlEstimate, ControlError, ControlOutput))
attitude, altitude, battery, gps = (partial(sample, kind) for kind in (Attitude, Altitude, Battery, Gps))
position, velocity, pilot = (partial(sample, kind) for kind in (Position, Velocity, Pilot))
link_state, recorder = partial(sample, LinkState), partial(sample, RecordStatus)
setup, image, pose, eyes = (partial(sample, kind) for kind in (CameraSetup, CameraFrame, VisionPose, VisionStats))
edge, raw, refusal = partial(sample, Transform), partial(sample, RawFrame), partial(sample, CommandEvent)


def link_health(at: float = AT, **change: Any) -> LinkHealth:
    return sample(LinkHealth, at, **{"state": link_state(at)} | change)


def tags(at: float = AT, *corners: Any, **change: Any) -> Tags:
    """Tags of an image, numbered from 0 where their corners are given."""
    seen = [sample(TagSighting, id=number, corners=four) for number, four in enumerate(corners)]
    return made(Tags, stamp(at), camera="down", tags=tuple(seen or [sample(TagSighting)]), **change)


_KEYS = {spec.carries: spec.suffix for spec in KEYS if spec.use is Use.PUBLISHED}


def keyed(*values: Any) -> list[tuple[str, Any]]:
    """Each value with its key."""
    return [(_KEYS[type(value)].replace("<camera>", getattr(value, "camera", "")), value) for value in values]


def hovering(at: float) -> list[tuple[str, Any]]:
    """Everything that is said while an aircraft hovers over its target, each with its key."""
    now = (alive, status, fence, estimate, error, output, attitude, altitude, battery, link_state, link_health, setup)
    return keyed(*(make(at) for make in now), pose(at - 0.1))


EVERY = [
    *keyed(edge(), edge(parent="camera/down", child="pad", static=False), attitude(roll=0.0, pitch=0.0, yaw=1.0)),
    *keyed(position(), gps(fix="none"), velocity(), battery(), pilot(), estimate(), output(roll=127), status()),
    *keyed(setup(), pose(), image(), image(coding="png", pixels=b"as it came"), tags()),
    *keyed(*(sample(kind) for kind in (LogEvent, FailsafeEvent, ModeEvent))),
    *(("raw/rx", raw()), ("raw/tx", raw(purpose="echo"))),
]
"""A value of every key that has a topic in ROS; the setup of a camera before its images."""

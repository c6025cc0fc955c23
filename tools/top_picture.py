"""The picture of docs/look.md: the terminal view of a vehicle whose state is given here, value by value."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from rich.text import Text

from mkdaemon.bus.keys import find
from mkdaemon.telemetry.state import Flight
from mkdaemon.view.top.panels import COLUMNS, VehicleBoard
from tools.screensvg import screen_svg

_NOW: Final = 1000.0
_STAMP: Final = {"monotonic": _NOW, "wall": 1.7e9, "boot": "b"}
_LINK: Final = {
    "condition": "up",
    "reason": "both directions proven",
    "since": _STAMP,
    "port": "/dev/ttyUSB0",
    "baud": 57600,
    "stamp": _STAMP,
    "hears_board": True,
    "board_hears_us": True,
}
_CORNERS: Final = {"corners": [(0.0, 0.0)] * 4}
_TRIP: Final = {"p50_ms": 52.7, "p95_ms": 80.0, "p99_ms": 94.9}


def _kind(key: str, rate: float, *, is_stale: bool) -> dict[str, Any]:
    found = {"key": key, "board": "nc", "frames": 100, "rate": rate, "asked_rate": 10.0, "age": 0.1}
    return {**found, "is_stale": is_stale}


_FIELDS: Final[dict[str, dict[str, Any]]] = {
    "health": {
        "is_alive": True,
        "reason": "the link is up",
        "boards": ("fc", "nc"),
        "firmware": {"fc": "2.12a"},
        "read_only": None,
        "link": "up",
        "motors_running": True,
        "error": None,
        "note": "",
        "battery_cells": 4,
    },
    "state/attitude": {
        "roll": math.radians(10.0),
        "pitch": math.radians(-5.0),
        "yaw": math.radians(30.0),
        "quaternion": (1.0, 0.0, 0.0, 0.0),
        "source": "nc/osd",
    },
    "state/flight": {
        **dict.fromkeys(Flight.model_fields),
        "motors_running": True,
        "is_flying": True,
        "gps_mode": "hold",
        "flying_time": 83.0,
        "source": "nc/osd",
        **dict.fromkeys(("manual_control", "range_limit", "target_reached", "serial_link_lost"), False),
        "error_code": 0,
        "error": "",
    },
    "state/altitude": {"above_start": 2.15, "source": "nc/osd"},
    "state/velocity": {
        "ground_speed": 1.25,
        "climb_rate": -0.4,
        "velocity_enu": (1.0, 0.75, -0.4),
        "course": 0.6,
        "source": "nc/osd",
    },
    "state/battery": {"voltage": 15.2, "current": 11.5, "used_mah": 812.0, "is_low": False, "source": "nc/osd"},
    "state/gps": {"satellites": 9, "fix": "valid", "is_usable": True, "is_home_set": True, "source": "nc/osd"},
    "state/pilot": {"rc_quality": 0.97, "has_signal": True, "throttle": None, "sticks": None, "source": "nc/osd"},
    "link/state": _LINK,
    "link/health": {
        "state": _LINK,
        "echo": _TRIP,
        "confirm": {},
        "link_tests": {"sent": 415, "answered": 409, "late": 1, "unanswered": 5, "lost": 5},
        "requests": {"sent": 190, "answered": 187, "unanswered": 3, "lost": 2, "withdrawn": 1},
        "stick_frames": {"sent": 2912, "answered": 2840, "unanswered": 71, "lost": 41, "replaced": 30, "waiting": 1},
        "kinds": [_kind("osd", 10.0, is_stale=False), _kind("debug", 0.0, is_stale=True)],
    },
    "control/status": {
        "phase": "flying",
        "reason": "ann flies",
        "setpoint_age": 0.02,
        "refused": 0,
        "external_control": "v2",
        "lease": {"holder": "ann", "epoch": 3, "ttl": 1.0, "left": 0.9},
        "pose_age": 0.1,
        "manoeuvre": "takeoff",
        "stage": "climbing",
        "hands": "holds hover",
    },
    "vision/down/stats": {
        "camera": "down",
        "state": "ok",
        "reason": "",
        "alarms": {},
        "source": "/dev/video0",
        "fps": 29.9,
        "width": 640,
        "height": 480,
        "posed": 0.94,
        "refused": {},
        "settings_refused": (),
        **dict.fromkeys(("processed", "dropped", "lost", "damaged", "reopened", "faults", "restarts"), 0),
        "detect_p50_ms": 9.0,
        "detect_p99_ms": 15.0,
        "latency_p50_ms": 38.0,
        "latency_p99_ms": 60.0,
    },
    "vision/down/tags": {
        "camera": "down",
        "sequence": 7,
        "stamped_by": "driver",
        "tags": [{"family": "tag36h11", "id": 48, "hamming": 0, "decision_margin": 60.0, "search": "roi", **_CORNERS}],
    },
    "vision/down/pose": {
        "camera": "down",
        "sequence": 7,
        "stamped_by": "driver",
        "target": "pad",
        "mode": "predicted",
        "position_target": (0.12, -0.34, 1.98),
        "quaternion_target_from_flu": (1.0, 0.0, 0.0, 0.0),
        "position_flu": (0.0, 0.0, -1.98),
        "quaternion_flu_from_target": (1.0, 0.0, 0.0, 0.0),
        "covariance": (0.0,) * 36,
        "position_cam": (0.0, 0.0, 1.98),
        "source": "edges",
        "points": 80,
        "quaternion_cam_from_target": (1.0, 0.0, 0.0, 0.0),
        "rms_px": 0.2,
        "ambiguity": None,
        "decided_by": "attitude",
        "decode_age": 0.0,
        "delivered": 0.01,
        "latency": 0.05,
    },
    "event/failsafe": {"action": "release", "reason": "the client died", "released": True},
    "event/log": {"level": "warning", "text": "heights contradict"},
}


def _value(suffix: str, fields: dict[str, Any]) -> Any:
    spec = find(suffix)
    assert spec is not None
    assert spec.carries is not None
    return spec.carries.model_validate({**fields, "stamp": _STAMP})


KNOWN: Final[dict[str, Any]] = {suffix: _value(suffix, fields) for suffix, fields in _FIELDS.items()}
"""Last values of a vehicle in flight, as the bus has them."""


def top_picture(_root: Path) -> str:
    """Return the screen, as SVG; its battery was last heard of 12 s ago."""
    board = VehicleBoard("quad")
    board.fleet = ["hexa", "quad"]
    for suffix, value in KNOWN.items():
        board.take(suffix, value, _NOW - (12.0 if suffix == "state/battery" else 0.1))
    lines = [Text.assemble(*((text, str(tone)) for text, tone in row)) for row in board.rows(_NOW)]
    return screen_svg(lines, COLUMNS)

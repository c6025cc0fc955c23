"""The picture of docs/look.md: the terminal view of a vehicle whose state is given here, value by value."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from rich.text import Text

from mkdaemon.view.top.panels import COLUMNS, Board
from tools.screensvg import screen_svg

KNOWN: Final[dict[str, dict[str, Any]]] = {
    "health": {
        "is_alive": True,
        "motors_running": True,
        "error": None,
        "read_only": None,
        "battery_cells": 4,
    },
    "state/attitude": {"roll": math.radians(10.0), "pitch": math.radians(-5.0), "yaw": math.radians(30.0)},
    "state/flight": {"is_flying": True, "gps_mode": "hold", "flying_time": 83.0},
    "state/altitude": {"above_start": 2.15},
    "state/velocity": {"ground_speed": 1.25, "climb_rate": -0.4},
    "state/battery": {"voltage": 15.2, "current": 11.5, "used_mah": 812.0, "is_low": False},
    "state/gps": {"satellites": 9, "fix": "valid", "is_usable": True},
    "state/pilot": {"rc_quality": 0.97, "has_signal": True},
    "link/state": {"condition": "up", "reason": "both directions proven"},
    "link/health": {
        "echo": {"p50_ms": 52.7, "p99_ms": 94.9},
        "link_tests": {"sent": 415, "answered": 409, "late": 1, "unanswered": 5, "lost": 5},
        "requests": {"sent": 190, "answered": 187, "unanswered": 3, "lost": 2, "withdrawn": 1},
        "stick_frames": {"sent": 2912, "answered": 2840, "unanswered": 71, "lost": 41, "replaced": 30, "waiting": 1},
        "kinds": [{"key": "osd", "is_stale": False}, {"key": "debug", "is_stale": True}],
    },
    "control/status": {
        "phase": "flying",
        "reason": "ann flies",
        "lease": {"holder": "ann"},
        "manoeuvre": "takeoff",
        "stage": "climbing",
        "hands": "holds hover",
    },
    "vision/down/stats": {"camera": "down", "state": "ok", "reason": "", "fps": 29.9, "posed": 0.94, "alarms": {}},
    "vision/down/pose": {"target": "pad", "position_target": (0.12, -0.34, 1.98)},
    "event/failsafe": {"action": "release", "reason": "the client died", "released": True},
    "event/log": {"level": "warning", "text": "heights contradict"},
}
"""Last values of a vehicle in flight, as the bus has them."""
_NOW: Final = 1000.0


def top_picture(_root: Path) -> str:
    """Return the screen, as SVG; its battery was last heard of 12 s ago."""
    board = Board("quad")
    board.fleet = ["hexa", "quad"]
    for suffix, fields in KNOWN.items():
        board.take(suffix, {**fields, "age": 12.0 if suffix == "state/battery" else 0.1}, _NOW)
    lines = [Text.assemble(*((text, str(tone)) for text, tone in row)) for row in board.rows(_NOW)]
    return screen_svg(lines, COLUMNS)

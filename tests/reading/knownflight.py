"""Last values of a vehicle in flight over its target, as the bus has them: nothing is wrong with any."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Final

from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import ControlStatus
from mkdaemon.telemetry.event import FailsafeEvent, LogEvent
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.state import Altitude, Attitude, Battery, Flight, Gps, Pilot, Velocity
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import Tags, VisionPose, VisionStats
from tests.values import made

AT: Final = Stamp(monotonic=1000.0, wall=1.7e9, boot="b")
"""When the values were published."""
_PROVEN: Final = {"condition": "up", "reason": "both directions proven", "hears_board": True, "board_hears_us": True}
_LINK: Final = made(LinkState, AT, since=AT, port="/dev/ttyUSB0", baud=57600, **_PROVEN)
_HEALTHY: Final = {"is_alive": True, "reason": "the link is up", "boards": ("fc", "nc"), "firmware": {"fc": "2.12a"}}
_UNKNOWN: Final = dict.fromkeys(Flight.model_fields.keys() - {"stamp"})
_FREE: Final = dict.fromkeys(("manual_control", "range_limit", "target_reached", "serial_link_lost"), False)
_FLIES: Final = {"motors_running": True, "is_flying": True, "gps_mode": "hold", "flying_time": 83.0}
_IMAGE: Final = {"camera": "down", "sequence": 7, "stamped_by": "driver"}
_TAG: Final = {"family": "tag36h11", "id": 48, "decision_margin": 60.0, "search": "roi", "hamming": 0}
_KIND: Final = {"board": "nc", "frames": 100, "asked_rate": 10.0, "age": 0.1}
_reported = partial(made, stamp=AT, source="nc/osd")


KNOWN: Final[dict[str, Any]] = {
    "health": made(VehicleHealth, AT, link="up", motors_running=True, battery_cells=4, **_HEALTHY),
    "state/attitude": _reported(Attitude, roll=math.radians(10.0), pitch=math.radians(-5.0), yaw=math.radians(30.0)),
    "state/flight": made(Flight, AT, **_UNKNOWN | _FREE | _FLIES | {"error_code": 0, "error": "", "source": "nc/osd"}),
    "state/altitude": _reported(Altitude, above_start=2.15),
    "state/velocity": _reported(
        Velocity, ground_speed=1.25, climb_rate=-0.4, velocity_enu=(1.0, 0.75, -0.4), course=0.6
    ),
    "state/battery": _reported(Battery, voltage=15.2, current=11.5, used_mah=812.0, is_low=False),
    "state/gps": _reported(Gps, satellites=9, fix="valid", is_usable=True, is_home_set=True),
    "state/pilot": _reported(Pilot, rc_quality=0.97, has_signal=True),
    "link/state": _LINK,
    "link/health": made(
        LinkHealth,
        AT,
        state=_LINK,
        echo={"p50_ms": 52.7, "p95_ms": 80.0, "p99_ms": 94.9},
        link_tests={"sent": 415, "answered": 409, "late": 1, "unanswered": 5, "lost": 5},
        requests={"sent": 190, "answered": 187, "unanswered": 3, "lost": 2, "withdrawn": 1},
        stick_frames={"sent": 2912, "answered": 2840, "unanswered": 71, "lost": 41, "replaced": 30, "waiting": 1},
        kinds=[
            {**_KIND, "key": "osd", "rate": 10.0, "is_stale": False},
            {**_KIND, "key": "debug", "rate": 0.0, "is_stale": True},
        ],
    ),
    "control/status": made(
        ControlStatus,
        AT,
        phase="flying",
        reason="ann flies",
        setpoint_age=0.02,
        external_control="v2",
        lease={"holder": "ann", "epoch": 3, "ttl": 1.0, "left": 0.9},
        pose_age=0.1,
        manoeuvre="takeoff",
        stage="climbing",
        hands="holds hover",
    ),
    "vision/down/stats": made(
        VisionStats,
        AT,
        camera="down",
        state="ok",
        source="/dev/video0",
        fps=29.9,
        width=640,
        height=480,
        posed=0.94,
        detect_p50_ms=9.0,
        detect_p99_ms=15.0,
        latency_p50_ms=38.0,
        latency_p99_ms=60.0,
    ),
    "vision/down/tags": made(Tags, AT, tags=[{**_TAG, "corners": [(0.0, 0.0)] * 4}], **_IMAGE),
    "vision/down/pose": made(
        VisionPose,
        AT,
        target="pad",
        mode="predicted",
        position_target=(0.12, -0.34, 1.98),
        position_flu=(0.0, 0.0, -1.98),
        position_cam=(0.0, 0.0, 1.98),
        source="edges",
        points=80,
        rms_px=0.2,
        covariance=(0.0,) * 36,
        decided_by="attitude",
        delivered=0.01,
        latency=0.05,
        **_IMAGE,
    ),
    "event/failsafe": made(FailsafeEvent, AT, action="release", reason="the client died", released=True),
    "event/log": made(LogEvent, AT, level="warning", text="heights contradict"),
}
"""By key."""

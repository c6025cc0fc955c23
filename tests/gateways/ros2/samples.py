"""Values of the daemon, as short as they can be written."""

from __future__ import annotations

from functools import partial

from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import ControlEstimate, ControlOutput, ControlStatus, Phase
from mkdaemon.telemetry.event import FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkState, RoundTripStats
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.state import Attitude, Battery, Gps, GpsFix, Pilot, Position, Velocity
from mkdaemon.telemetry.traffic import RawFrame
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import (
    CameraSetup,
    EyeState,
    LensShape,
    Tags,
    TagSighting,
    Transform,
    VisionPose,
    VisionStats,
)
from tests.values import made

STAMP = Stamp(monotonic=100.0, wall=1_600_000_000.25, boot="abcd1234", synchronised=True)
value = partial(made, stamp=STAMP)


def at(seconds):
    """A stamp so long after `STAMP`."""
    return STAMP.model_copy(update={"monotonic": STAMP.monotonic + seconds, "wall": STAMP.wall + seconds})


def attitude(roll=0.0, pitch=0.0, yaw=0.0, stamp=STAMP):
    quaternion = quaternion_from_rotation(rotation_from_euler(roll, pitch, yaw))
    return value(Attitude, stamp=stamp, source="nc/osd", quaternion=quaternion, roll=roll, pitch=pitch, yaw=yaw)


def position(enu=(1.0, 2.0, 3.0), stamp=STAMP):
    place = {
        "latitude_deg": 53.25,
        "longitude_deg": -7.5,
        "altitude": 12.5,
        "altitude_above_start": 3.0,
        "home_distance": 2.2,
    }
    return value(Position, stamp=stamp, position_enu=enu, home_latitude_deg=53.0, home_longitude_deg=-7.0, **place)


def velocity(enu=(1.0, -2.0, 0.5)):
    return value(Velocity, velocity_enu=enu, ground_speed=2.2, climb_rate=0.5)


def gps(fix=GpsFix.NONE):
    return value(Gps, satellites=3, fix=fix)


def battery(current=12.5, is_low=False, stamp=STAMP):
    return value(Battery, stamp=stamp, voltage=15.5, current=current, used_mah=100.0, is_low=is_low)


def pilot(sticks=(0.0, 0.0, 0.0)):
    return value(Pilot, rc_quality=0.9, has_signal=True, throttle=0.0, sticks=sticks)


def estimate(**changed):
    fields = {
        "target": "pad",
        "position": (0.5, -0.25, 2.0),
        "velocity": (0.25, 0.5, -0.125),
        "position_sd": (0.1, 0.2, 0.3),
        "covariance": ((0.01, 0.0, 0.02), (0.04, 0.0, 0.05), (0.09, 0.0, 0.08)),
        "image_age": 0.1,
    }
    return value(ControlEstimate, **fields | changed)


def output(pitch=0, roll=0, yaw=0, throttle=0, *, limited=False):
    return value(ControlOutput, pitch=pitch, roll=roll, yaw=yaw, throttle=throttle, limited=limited)


def raw(content=b"#bb?li=S]A>====NX\r", **more):
    return value(RawFrame, sequence=7, raw=content, **more)


def vision_pose(**changed):
    fields = {
        "target": "pad",
        "position_target": (0.5, -0.25, 2.0),
        "covariance": tuple(float(n) for n in range(36)),
        "position_cam": (0.0, 0.0, 2.0),
        "quaternion_cam_from_target": (0.0, 1.0, 0.0, 0.0),
    }
    return value(VisionPose, camera="down", **fields | changed)


def edge(parent="body", child="camera/down", *, static=True, stamp=STAMP):
    moved = {"translation": (0.1, 0.0, -0.05), "quaternion": (0.0, 1.0, 0.0, 0.0)}
    return value(Transform, stamp=stamp, parent=parent, child=child, static=static, **moved)


def frame(coding="gray8", pixels=bytes(range(12)), width=4, height=3):
    return value(CameraFrame, camera="down", width=width, height=height, coding=coding, pixels=pixels)


def setup(model="pinhole", *, is_calibrated=True):
    numbers = {"width": 640, "height": 480, "fx": 425.0, "fy": 424.0, "cx": 319.5, "cy": 239.5}
    lens = LensShape(model=model, distortion=(-0.12, 0.02, 0.0, 0.0, 0.0), **numbers)
    return value(CameraSetup, camera="down", lens=lens if is_calibrated else None)


def tags(*corners):
    seen = [
        value(TagSighting, family="tag36h11", id=n, hamming=1, decision_margin=40.0, corners=four)
        for n, four in enumerate(corners)
    ]
    return value(Tags, camera="down", tags=tuple(seen))


def status(phase=Phase.FREE, reason="no lease was requested yet", **more):
    return value(ControlStatus, phase=phase, reason=reason, **more)


def link(condition=LinkCondition.UP, reason="all is well"):
    state = value(LinkState, condition=condition, reason=reason)
    return value(LinkHealth, state=state, echo=RoundTripStats(p50_ms=12.0))


def health(*, is_alive=True, read_only=None, error=None, cells=None):
    facts = {"is_alive": is_alive, "reason": "boards answer", "boards": ("nc",), "link": "up"}
    return value(VehicleHealth, read_only=read_only, error=error, battery_cells=cells, **facts)


def eyes(state=EyeState.OK, reason="", alarms=None):
    return value(VisionStats, camera="down", state=state, reason=reason, alarms=alarms or {}, fps=30.0, posed=0.9)


def recorder(state=RecorderState.RECORDING, **changed):
    return value(RecordStatus, state=state, **changed)


SQUARE = ((10.0, 10.0), (30.0, 10.0), (30.0, 30.0), (10.0, 30.0))
"""Top-left, top-right, bottom-right, bottom-left of a tag [px]."""
EVERY = (
    ("tf", edge()),
    ("tf", edge("camera/down", "pad", static=False)),
    ("state/attitude", attitude(yaw=1.0)),
    ("state/position", position()),
    ("state/gps", gps()),
    ("state/velocity", velocity()),
    ("state/battery", battery()),
    ("state/pilot", pilot()),
    ("control/estimate", estimate()),
    ("control/output", output(roll=127, limited=True)),
    ("control/status", status()),
    ("vision/down/setup", setup()),
    ("vision/down/pose", vision_pose()),
    ("vision/down/image", frame()),
    ("vision/down/image", frame("png", b"as it came")),
    ("vision/down/tags", tags(SQUARE)),
    ("event/log", LogEvent(stamp=STAMP, level="info", text="look")),
    ("event/failsafe", FailsafeEvent(stamp=STAMP, action="release", reason="why")),
    ("event/mode", ModeEvent(stamp=STAMP, before="free", after="leased", reason="why")),
    ("raw/rx", raw()),
    ("raw/tx", raw(purpose="echo")),
)
"""A value of every key that has a topic; the setup of a camera before its images."""

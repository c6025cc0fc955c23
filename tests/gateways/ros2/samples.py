"""Values of the daemon, as short as they can be written."""

from __future__ import annotations

from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import ControlEstimate, ControlOutput, ControlStatus, Phase
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkState, RoundTripStats
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

STAMP = Stamp(monotonic=100.0, wall=1_600_000_000.25, boot="abcd1234", synchronised=True)


def at(seconds):
    """A stamp so long after `STAMP`."""
    return STAMP.model_copy(update={"monotonic": STAMP.monotonic + seconds, "wall": STAMP.wall + seconds})


def attitude(roll=0.0, pitch=0.0, yaw=0.0, stamp=STAMP):
    quaternion = quaternion_from_rotation(rotation_from_euler(roll, pitch, yaw))
    return Attitude(stamp=stamp, source="nc/osd", quaternion=quaternion, roll=roll, pitch=pitch, yaw=yaw)


def position(enu=(1.0, 2.0, 3.0), stamp=STAMP):
    return Position(
        stamp=stamp,
        source="nc/osd",
        latitude_deg=53.25,
        longitude_deg=-7.5,
        altitude=12.5,
        altitude_above_start=3.0,
        position_enu=enu,
        home_latitude_deg=53.0,
        home_longitude_deg=-7.0,
        home_distance=2.2,
    )


def velocity(enu=(1.0, -2.0, 0.5)):
    return Velocity(stamp=STAMP, source="nc/osd", velocity_enu=enu, ground_speed=2.2, course=0.0, climb_rate=0.5)


def gps(fix=GpsFix.NONE):
    return Gps(stamp=STAMP, source="nc/osd", satellites=3, fix=fix, is_usable=False, is_home_set=False)


def battery(current=12.5, is_low=False, stamp=STAMP):
    return Battery(stamp=stamp, source="nc/osd", voltage=15.5, current=current, used_mah=100.0, is_low=is_low)


def pilot(sticks=(0.0, 0.0, 0.0)):
    return Pilot(stamp=STAMP, source="fc/data", rc_quality=0.9, has_signal=True, throttle=0.0, sticks=sticks)


def estimate(**changed):
    fields = {
        "target": "pad",
        "position": (0.5, -0.25, 2.0),
        "velocity": (0.25, 0.5, -0.125),
        "tilt": (0.0, 0.0),
        "disturbance": (0.0, 0.0),
        "yaw": 0.0,
        "hover_throttle": -2.0,
        "position_sd": (0.1, 0.2, 0.3),
        "covariance": ((0.01, 0.0, 0.02), (0.04, 0.0, 0.05), (0.09, 0.0, 0.08)),
        "image_age": 0.1,
        "innovation": 0.5,
        "caution": 0.0,
    }
    return ControlEstimate(stamp=STAMP, **fields | changed)


def output(pitch=0, roll=0, yaw=0, throttle=0, *, limited=False):
    return ControlOutput(
        stamp=STAMP,
        epoch=1,
        sequence=1,
        frame=1,
        age=0.01,
        pitch=pitch,
        roll=roll,
        yaw=yaw,
        throttle=throttle,
        limited=limited,
    )


def raw(content=b"#bb?li=S]A>====NX\r", **more):
    return RawFrame(stamp=STAMP, sequence=7, raw=content, **more)


def vision_pose(**changed):
    fields = {
        "target": "pad",
        "position_target": (0.5, -0.25, 2.0),
        "quaternion_target_from_flu": (1.0, 0.0, 0.0, 0.0),
        "position_flu": (-0.5, 0.25, -2.0),
        "quaternion_flu_from_target": (1.0, 0.0, 0.0, 0.0),
        "covariance": tuple(float(n) for n in range(36)),
        "position_cam": (0.0, 0.0, 2.0),
        "quaternion_cam_from_target": (0.0, 1.0, 0.0, 0.0),
        "source": "edges",
        "mode": "flow",
        "points": 40,
        "rms_px": 0.3,
        "ambiguity": None,
        "decided_by": "image",
        "decode_age": 0.1,
        "delivered": 0.05,
        "latency": 0.07,
    }
    return VisionPose(stamp=STAMP, camera="down", sequence=1, stamped_by="driver", **fields | changed)


def edge(parent="body", child="camera/down", *, static=True, stamp=STAMP):
    return Transform(
        stamp=stamp,
        parent=parent,
        child=child,
        translation=(0.1, 0.0, -0.05),
        quaternion=(0.0, 1.0, 0.0, 0.0),
        static=static,
    )


def frame(coding="gray8", pixels=bytes(range(12)), width=4, height=3):
    return CameraFrame(stamp=STAMP, camera="down", sequence=1, width=width, height=height, coding=coding, pixels=pixels)


def setup(model="pinhole", *, is_calibrated=True):
    lens = LensShape(
        width=640,
        height=480,
        fx=425.0,
        fy=424.0,
        cx=319.5,
        cy=239.5,
        model=model,
        distortion=(-0.12, 0.02, 0.0, 0.0, 0.0),
    )
    return CameraSetup(
        stamp=STAMP,
        camera="down",
        lens=lens if is_calibrated else None,
        position_flu=None,
        quaternion_flu_from_cam=None,
        targets=(),
    )


def tags(*corners):
    seen = [
        TagSighting(family="tag36h11", id=n, hamming=1, decision_margin=40.0, corners=four, search="roi")
        for n, four in enumerate(corners)
    ]
    return Tags(stamp=STAMP, camera="down", sequence=1, stamped_by="driver", tags=tuple(seen))


def status(phase=Phase.FREE, reason="no lease was requested yet", **more):
    return ControlStatus(
        stamp=STAMP, phase=phase, reason=reason, lease=None, setpoint_age=None, refused=0, external_control=None, **more
    )


def link(condition=LinkCondition.UP, reason="all is well"):
    state = LinkState(
        stamp=STAMP,
        condition=condition,
        reason=reason,
        since=STAMP,
        port="/dev/ttyUSB0",
        baud=57600,
        hears_board=True,
        board_hears_us=True,
    )
    return LinkHealth(stamp=STAMP, state=state, echo=RoundTripStats(p50_ms=12.0), confirm=RoundTripStats())


def health(*, is_alive=True, read_only=None, error=None, cells=None):
    return VehicleHealth(
        stamp=STAMP,
        is_alive=is_alive,
        reason="boards answer",
        boards=("nc",),
        firmware={"nc": "2.14"},
        read_only=read_only,
        link="up",
        motors_running=False,
        error=error,
        note="",
        battery_cells=cells,
    )


def eyes(state=EyeState.OK, reason="", alarms=None):
    return VisionStats(
        stamp=STAMP,
        camera="down",
        state=state,
        reason=reason,
        alarms=alarms or {},
        source="/dev/video0",
        width=640,
        height=480,
        fps=30.0,
        processed=1,
        dropped=0,
        lost=0,
        damaged=0,
        reopened=0,
        faults=0,
        restarts=0,
        posed=0.9,
        refused={},
        detect_p50_ms=5.0,
        detect_p99_ms=9.0,
        latency_p50_ms=60.0,
        latency_p99_ms=90.0,
        settings_refused=(),
    )

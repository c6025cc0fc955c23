"""The table of what is published: a key of the daemon, a topic, its type, the conversion, the quality of service."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from mkdaemon.gateways.keys import matches
from mkdaemon.gateways.ros2 import conversions, diagnostics
from mkdaemon.gateways.ros2.messages import ConversionScene, name_part
from mkdaemon.reading.known import EACH


class Quality(Enum):
    """Qualities of service, by what ROS expects of such a topic."""

    SENSOR = "sensor"
    """Reliable, the newest five: streams. REP 2003: a driver publishes reliably; best-effort subscribers receive."""
    RELIABLE = "reliable"
    """Reliable, the newest ten."""
    LATCHED = "latched"
    """Reliable and transient local: who comes late gets the last one."""
    TREE = "tree"
    """Of `/tf`: reliable, the newest hundred."""

    @property
    def depth(self) -> int:
        """How many messages wait for a slow subscriber; then the oldest is dropped."""
        return _DEPTHS[self]

    @property
    def is_latched(self) -> bool:
        """A late subscriber gets the last message: transient local."""
        return self is Quality.LATCHED


_DEPTHS: Final = {Quality.SENSOR: 5, Quality.RELIABLE: 10, Quality.LATCHED: 1, Quality.TREE: 100}


Convert = Callable[[Any, ConversionScene], Any]
"""Makes a message, a list of them, or None."""


@dataclass(frozen=True, slots=True)
class Ros2Topic:
    """One row.

    Attributes:
        name: below the vehicle's namespace; absolute where ROS has one place for it. `{camera}` is the camera's.
        key: of the daemon; a `*` stands for a camera.
        type: of the message.
        convert: makes it.
        frame: of its headers, as the page writes it; empty where it has no header, or frames of both ends.
        quality: of service.
    """

    name: str
    key: str
    type: str
    convert: Convert
    frame: str = ""
    quality: Quality = Quality.SENSOR

    def is_of(self, suffix: str) -> bool:
        """Whether a key is one that its own stands for."""
        return matches(self.key, suffix)

    def name_for(self, suffix: str) -> str:
        """Its name for one key that its own stands for."""
        camera = suffix.split("/")[1] if "*" in self.key else ""
        return self.name.format(camera=name_part(camera))

    def messages(self, value: Any, scene: ConversionScene) -> Sequence[Any]:
        """Every message that a value makes."""
        made = self.convert(value, scene)
        return made if isinstance(made, list) else () if made is None else (made,)

    @property
    def word(self) -> str:
        """How the parameters name it: without `{camera}/`, with `.` for `/`."""
        return self.name.removeprefix("{camera}/").strip("/").replace("/", ".")


_IMAGE: Final = "vision/*/image"
_TAGS: Final = "vision/*/tags"
_TF: Final = "tf2_msgs/msg/TFMessage"
_LOG: Final = "rcl_interfaces/msg/Log"
_INFO: Final = "sensor_msgs/msg/CameraInfo"
_STATUS: Final = "diagnostic_msgs/msg/DiagnosticStatus"
_BODY: Final = "base_link"
_CAMERA: Final = "<camera>_optical_frame"
_TARGET: Final = "target/<name>"

TOPICS: Final = (
    Ros2Topic("fix", "state/position", "sensor_msgs/msg/NavSatFix", conversions.fix, _BODY),
    Ros2Topic("fix", "state/gps", "sensor_msgs/msg/NavSatFix", conversions.no_fix, _BODY),
    Ros2Topic("velocity", "state/velocity", "geometry_msgs/msg/TwistStamped", conversions.velocity, "map"),
    Ros2Topic("imu", "state/attitude", "sensor_msgs/msg/Imu", conversions.imu, _BODY),
    Ros2Topic("battery_state", "state/battery", "sensor_msgs/msg/BatteryState", conversions.battery_state, _BODY),
    Ros2Topic("odom", "control/estimate", "nav_msgs/msg/Odometry", conversions.odometry, _TARGET),
    Ros2Topic("pose", "vision/*/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", conversions.vision_pose, _TARGET),
    Ros2Topic("/tf", "tf", _TF, conversions.edge, quality=Quality.TREE),
    Ros2Topic("/tf", "state/position", _TF, conversions.place, quality=Quality.TREE),
    Ros2Topic("/tf_static", "tf", _TF, conversions.mount, quality=Quality.LATCHED),
    Ros2Topic("/tf_static", "state/position", _TF, conversions.origin, quality=Quality.LATCHED),
    Ros2Topic("{camera}/image", _IMAGE, "sensor_msgs/msg/Image", conversions.image, _CAMERA),
    Ros2Topic("{camera}/image/compressed", _IMAGE, "sensor_msgs/msg/CompressedImage", conversions.compressed, _CAMERA),
    Ros2Topic("{camera}/camera_info", "vision/*/setup", _INFO, conversions.info, _CAMERA, Quality.LATCHED),
    Ros2Topic("{camera}/camera_info", _IMAGE, _INFO, conversions.info_of_image, _CAMERA, Quality.LATCHED),
    Ros2Topic("{camera}/tags", _TAGS, "apriltag_msgs/msg/AprilTagDetectionArray", conversions.detections, _CAMERA),
    Ros2Topic("{camera}/tag_markers", _TAGS, "visualization_msgs/msg/ImageMarker", conversions.markers, _CAMERA),
    Ros2Topic("sticks", "control/output", "sensor_msgs/msg/Joy", conversions.sticks, _BODY),
    Ros2Topic("pilot", "state/pilot", "sensor_msgs/msg/Joy", conversions.pilot, _BODY),
    Ros2Topic("status", "control/status", _STATUS, diagnostics.control_status, quality=Quality.LATCHED),
    *(
        Ros2Topic("events", f"event/{name}", _LOG, conversions.event, quality=Quality.RELIABLE)
        for name in ("log", "failsafe", "mode")
    ),
    Ros2Topic("raw/rx", "raw/rx", "std_msgs/msg/UInt8MultiArray", conversions.raw_frame),
    Ros2Topic("raw/tx", "raw/tx", "std_msgs/msg/UInt8MultiArray", conversions.raw_frame),
)
"""Everything that is published with a value; a further topic is one row here, and its conversion."""

DIAGNOSTICS: Final = "/diagnostics"
"""Of the newest values: `diagnostics.report`."""
REPORTING: Final = 1.0
"""Between two of them [s]."""
KEPT: Final = frozenset({"state/attitude", "state/position", "health", "vision/*/setup", "vision/*/pose", "tf", *EACH})
"""Keys whose newest value a conversion or a diagnosis looks at."""


def words() -> list[str]:
    """How the parameters name the topics, each once."""
    return list(dict.fromkeys(topic.word for topic in TOPICS))


def keys_of(topics: Iterable[Ros2Topic]) -> list[str]:
    """Every key that must be subscribed."""
    return sorted({topic.key for topic in topics} | KEPT)


class Newest:
    """The newest value of every key that something looks at, by suffix; mounts of cameras under `mounts`."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {"mounts": ()}

    def keeps(self, suffix: str) -> bool:
        """Whether it wants this key."""
        return any(matches(pattern, suffix) for pattern in KEPT)

    def keep(self, suffix: str, value: Any) -> None:
        """Take a value."""
        if suffix != "tf":
            self.values[suffix] = value
        elif value.static:
            others = tuple(mount for mount in self.values["mounts"] if mount.child != value.child)
            self.values["mounts"] = (*others, value)

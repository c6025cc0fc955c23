"""A ROS 2 bag (MCAP with CDR) by the `rosbags` library.

Our axes are those of REP-103: ENU world, FLU body, radians, metres, so nothing is turned; quaternions go from
(w, x, y, z) to ROS's fields by name. Frames are named as REP-105 has it where it has a name: `base_link` is our `body`.
Stamps are the publish wall times. Covariances that a board does not tell are marked as unknown, as each type says.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from mkdaemon.client.export.values import Value
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.record.entry import NANOSECONDS, nanoseconds

BODY: Final = "base_link"
FULL_STICK: Final = 127.0
"""Count of a stick at its end; axes of a Joy go from -1 to 1."""
LAST_SECOND: Final = (1 << 31) - 1
"""Of a stamp in ROS [s; Unix time]."""
VERSION: Final = 9
"""Of the bag's metadata: ROS 2 Jazzy and later; older readers take it too."""
_Message = tuple[str, str, Any]
"""Topic below the vehicle, type, message."""


class RosExport:
    """Makes ROS messages of values.

    Attributes:
        types: the types of ROS 2 Humble.
    """

    def __init__(self) -> None:
        """Load the types.

        Raises:
            ConfigError: rosbags is not installed.
        """
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            msg = 'a ROS 2 bag needs rosbags: pip install "mkdaemon[export]"'
            raise ConfigError(msg) from None
        self.types = get_typestore(Stores.ROS2_HUMBLE)
        self._makers: dict[str, Callable[[Value], list[_Message]]] = {
            "state/position": self._fix,
            "state/attitude": self._imu,
            "state/battery": self._battery,
            "control/estimate": self._estimate,
            "control/output": self._sticks,
            "tf": self._transform,
        }

    def write(self, values: Iterable[Value], path: Path, *, overwrite: bool) -> int:
        """Write a bag, whole or not at all; returns the number of messages.

        Args:
            values: of a recording.
            path: folder of the bag.
            overwrite: replace a bag that is there.

        Raises:
            ConfigError: it is there already and `overwrite` is off, or its folder is not there.
            MkError: it cannot be written, or nothing in the recording has a message of ROS.
        """
        from rosbags.rosbag2 import StoragePlugin, Writer

        if path.exists() and not overwrite:
            msg = f"{path}: exists already; choose another name, or overwrite it with --force"
            raise ConfigError(msg)
        if not path.parent.is_dir():
            msg = f"{path}: there is no folder {path.parent}; make it first"
            raise ConfigError(msg)
        try:
            with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as fresh:
                with Writer(Path(fresh) / path.name, version=VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
                    count = self._fill(writer, values)
                if count == 0:
                    msg = f"{path}: nothing in the recording has a message of ROS; --format csv takes all keys"
                    raise MkError(msg)
                if path.exists():
                    shutil.rmtree(path)
                (Path(fresh) / path.name).rename(path)
        except OSError as error:
            msg = f"{path}: cannot be written ({error.strerror}); choose another place"
            raise MkError(msg) from error
        return count

    def _fill(self, writer: Any, values: Iterable[Value]) -> int:
        connections: dict[str, Any] = {}
        count = 0
        for value in values:
            for topic, kind, message in self._messages(value):
                name = topic if topic.startswith("/") else f"/{value.vehicle}/{topic}"
                if name not in connections:
                    qos = self._latched() if name == "/tf_static" else ()
                    connections[name] = writer.add_connection(
                        name, kind, typestore=self.types, offered_qos_profiles=qos
                    )
                cdr = self.types.serialize_cdr(message, kind)
                writer.write(connections[name], nanoseconds(value.wall), cdr)
                count += 1
        return count

    def _messages(self, value: Value) -> list[_Message]:
        is_pose = value.suffix.startswith("vision/") and value.suffix.endswith("/pose")
        make = self._pose if is_pose else self._makers.get(value.suffix)
        return [] if make is None else make(value)

    # -- messages -------------------------------------------------------------------------------------------------

    def _fix(self, value: Value) -> list[_Message]:
        import numpy as np

        status = self._new("sensor_msgs/msg/NavSatStatus", status=0, service=1)
        altitude = value.number_or_none("altitude")
        message = self._new(
            "sensor_msgs/msg/NavSatFix",
            header=self._header(value, BODY),
            status=status,
            latitude=value.number("latitude_deg"),
            longitude=value.number("longitude_deg"),
            altitude=math.nan if altitude is None else altitude,
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )
        return [("fix", "sensor_msgs/msg/NavSatFix", message)]

    def _imu(self, value: Value) -> list[_Message]:
        import numpy as np

        unknown = np.zeros(9)
        missing = np.array([-1.0] + [0.0] * 8)
        zero = self._vector(0.0, 0.0, 0.0)
        message = self._new(
            "sensor_msgs/msg/Imu",
            header=self._header(value, BODY),
            orientation=self._quaternion(value.numbers("quaternion", 4)),
            orientation_covariance=unknown,
            angular_velocity=zero,
            angular_velocity_covariance=missing,
            linear_acceleration=zero,
            linear_acceleration_covariance=missing,
        )
        return [("imu", "sensor_msgs/msg/Imu", message)]

    def _battery(self, value: Value) -> list[_Message]:
        import numpy as np

        current = value.number_or_none("current")
        message = self._new(
            "sensor_msgs/msg/BatteryState",
            header=self._header(value, BODY),
            voltage=value.number("voltage"),
            temperature=math.nan,
            current=math.nan if current is None else -current,
            charge=math.nan,
            capacity=math.nan,
            design_capacity=math.nan,
            percentage=math.nan,
            power_supply_status=2,
            power_supply_health=0,
            power_supply_technology=3,
            present=True,
            cell_voltage=np.zeros(0, dtype=np.float32),
            cell_temperature=np.zeros(0, dtype=np.float32),
            location="",
            serial_number="",
        )
        return [("battery", "sensor_msgs/msg/BatteryState", message)]

    def _pose(self, value: Value) -> list[_Message]:
        import numpy as np

        topic = value.suffix
        header = self._header(value, f"target/{value.text('target')}")
        pose = self._posed(value.numbers("position_target", 3), value.numbers("quaternion_target_from_flu", 4))
        certain = self._new("geometry_msgs/msg/PoseStamped", header=header, pose=pose)
        spread = self._new(
            "geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.array(value.numbers("covariance", 36))
        )
        whole = self._new("geometry_msgs/msg/PoseWithCovarianceStamped", header=header, pose=spread)
        return [
            (topic, "geometry_msgs/msg/PoseStamped", certain),
            (f"{topic}_with_covariance", "geometry_msgs/msg/PoseWithCovarianceStamped", whole),
        ]

    def _estimate(self, value: Value) -> list[_Message]:
        yaw = value.number("yaw")
        quaternion = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
        header = self._header(value, f"target/{value.text('target')}")
        pose = self._posed(value.numbers("position", 3), quaternion)
        message = self._new("geometry_msgs/msg/PoseStamped", header=header, pose=pose)
        return [("control/estimate", "geometry_msgs/msg/PoseStamped", message)]

    def _sticks(self, value: Value) -> list[_Message]:
        import numpy as np

        axes = [value.number(name) / FULL_STICK for name in ("pitch", "roll", "yaw", "throttle")]
        message = self._new(
            "sensor_msgs/msg/Joy",
            header=self._header(value, BODY),
            axes=np.array(axes, dtype=np.float32),
            buttons=np.array([int(bool(value.fields.get("limited")))], dtype=np.int32),
        )
        return [("control/sticks", "sensor_msgs/msg/Joy", message)]

    def _transform(self, value: Value) -> list[_Message]:
        x, y, z = value.numbers("translation", 3)
        transform = self._new(
            "geometry_msgs/msg/Transform",
            translation=self._vector(x, y, z),
            rotation=self._quaternion(value.numbers("quaternion", 4)),
        )
        stamped = self._new(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(value, _frame(value.text("parent"))),
            child_frame_id=_frame(value.text("child")),
            transform=transform,
        )
        message = self._new("tf2_msgs/msg/TFMessage", transforms=[stamped])
        return [("/tf_static" if value.fields.get("static") else "/tf", "tf2_msgs/msg/TFMessage", message)]

    # -- parts ----------------------------------------------------------------------------------------------------

    def _new(self, kind: str, **fields: Any) -> Any:
        return self.types.types[kind](**fields)

    def _header(self, value: Value, frame: str) -> Any:
        whole, rest = divmod(nanoseconds(value.wall), NANOSECONDS)
        if whole > LAST_SECOND:
            msg = (
                f"{value.suffix} of {value.vehicle} is of a time after 2038, which ROS cannot have; `mkctl log cut` it"
            )
            raise MkError(msg)
        stamp = self._new("builtin_interfaces/msg/Time", sec=whole, nanosec=rest)
        return self._new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _vector(self, x: float, y: float, z: float) -> Any:
        return self._new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _quaternion(self, wxyz: Iterable[float]) -> Any:
        w, x, y, z = wxyz
        return self._new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _posed(self, position: Iterable[float], wxyz: Iterable[float]) -> Any:
        x, y, z = position
        point = self._new("geometry_msgs/msg/Point", x=x, y=y, z=z)
        return self._new("geometry_msgs/msg/Pose", position=point, orientation=self._quaternion(wxyz))

    @staticmethod
    def _latched() -> tuple[Any, ...]:
        """What late subscribers of `/tf_static` need."""
        from rosbags.interfaces import (
            Qos,
            QosDurability,
            QosHistory,
            QosLiveliness,
            QosReliability,
            QosTime,
        )

        never = QosTime(0, 0)
        return (
            Qos(
                QosHistory.KEEP_LAST,
                1,
                QosReliability.RELIABLE,
                QosDurability.TRANSIENT_LOCAL,
                never,
                never,
                QosLiveliness.AUTOMATIC,
                never,
                False,
            ),
        )


def _frame(name: str) -> str:
    """The name of a frame in ROS."""
    return BODY if name == "body" else name

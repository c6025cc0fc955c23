"""A ROS 2 bag (MCAP with CDR) by the `rosbags` library.

Frames are named as REP-105 has it where it has a name: `base_link` is our `body`. Stamps are the publish wall times.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from mkdaemon.client.export.values import Value
from mkdaemon.client.rosmessages import (
    LAST_SECOND,
    battery_state,
    fix,
    imu,
    joy,
    pose,
    stamped_pose_with_covariance,
    transform,
    tree,
)
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.record.entry import NANOSECONDS, nanoseconds

BODY: Final = "base_link"
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
        place = (value.number("latitude_deg"), value.number("longitude_deg"), value.number_or_none("altitude"))
        return [("fix", "sensor_msgs/msg/NavSatFix", fix(self, self._header(value, BODY), 0, *place))]

    def _imu(self, value: Value) -> list[_Message]:
        message = imu(self, self._header(value, BODY), value.numbers("quaternion", 4))
        return [("imu", "sensor_msgs/msg/Imu", message)]

    def _battery(self, value: Value) -> list[_Message]:
        electric = value.number("voltage"), value.number_or_none("current")
        message = battery_state(self, self._header(value, BODY), *electric)
        return [("battery", "sensor_msgs/msg/BatteryState", message)]

    def _pose(self, value: Value) -> list[_Message]:
        topic = value.suffix
        header = self._header(value, f"target/{value.text('target')}")
        place = pose(self, value.numbers("position_target", 3), value.numbers("quaternion_target_from_flu", 4))
        certain = self.new("geometry_msgs/msg/PoseStamped", header=header, pose=place)
        whole = stamped_pose_with_covariance(self, header, place, value.numbers("covariance", 36))
        return [
            (topic, "geometry_msgs/msg/PoseStamped", certain),
            (f"{topic}_with_covariance", "geometry_msgs/msg/PoseWithCovarianceStamped", whole),
        ]

    def _estimate(self, value: Value) -> list[_Message]:
        yaw = value.number("yaw")
        upright = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
        header = self._header(value, f"target/{value.text('target')}")
        place = pose(self, value.numbers("position", 3), upright)
        message = self.new("geometry_msgs/msg/PoseStamped", header=header, pose=place)
        return [("control/estimate", "geometry_msgs/msg/PoseStamped", message)]

    def _sticks(self, value: Value) -> list[_Message]:
        counts = [value.number(name) for name in ("pitch", "roll", "yaw", "throttle")]
        message = joy(self, self._header(value, BODY), counts, button=bool(value.fields.get("limited")))
        return [("control/sticks", "sensor_msgs/msg/Joy", message)]

    def _transform(self, value: Value) -> list[_Message]:
        moved = value.numbers("translation", 3), value.numbers("quaternion", 4)
        edge = transform(self, self._header(value, _frame(value.text("parent"))), _frame(value.text("child")), *moved)
        topic = "/tf_static" if value.fields.get("static") else "/tf"
        return [(topic, "tf2_msgs/msg/TFMessage", tree(self, edge))]

    # -- parts ----------------------------------------------------------------------------------------------------

    def new(self, kind: str, **fields: Any) -> Any:
        """Make a message of the types of the bag."""
        return self.types.types[kind](**fields)

    def _header(self, value: Value, frame: str) -> Any:
        whole, rest = divmod(nanoseconds(value.wall), NANOSECONDS)
        if whole > LAST_SECOND:
            msg = (
                f"{value.suffix} of {value.vehicle} is of a time after 2038, which ROS cannot have; `mkctl log cut` it"
            )
            raise MkError(msg)
        stamp = self.new("builtin_interfaces/msg/Time", sec=whole, nanosec=rest)
        return self.new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

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

"""A recording as a ROS 2 bag (MCAP with CDR) by the `rosbags` library: the topics, types and frames of the gateway.

Rows and conversions are those of `topics.TOPICS`. Stamps and log times are the wall times of the values.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from mkdaemon.client.export.values import ExportedValue
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.faults import expressible
from mkdaemon.gateways.ros2.diagnostics import report
from mkdaemon.gateways.ros2.messages import LAST_SECOND, ConversionScene, Frames, name_part
from mkdaemon.gateways.ros2.topics import DIAGNOSTICS, REPORTING, TOPICS, Newest, Quality, Ros2Topic
from mkdaemon.stamp import Stamp, nanoseconds
from mkdaemon.telemetry.base import Stamped

VERSION: Final = 9
"""Of the bag's metadata: ROS 2 Jazzy and later; older readers take it too."""
APRILTAG: Final = {
    "apriltag_msgs/msg/Point": "float64 x\nfloat64 y\n",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "Point centre\nPoint[4] corners\nfloat64[9] homography\n"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": "std_msgs/Header header\nAprilTagDetection[] detections\n",
}
"""Types that rosbags does not bring, as apriltag_msgs 2.0 defines them."""
_Message = tuple[str, str, Quality, Any]
"""Topic, type, quality of service, message."""


class BagTypes:
    """Messages of rosbags, with the types of ROS 2 Humble.

    Attributes:
        store: the types.
    """

    def __init__(self) -> None:
        """Load the types.

        Raises:
            ConfigError: rosbags is not installed.
        """
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError:
            msg = 'a ROS 2 bag needs rosbags: pip install "mkdaemon[export]"'
            raise ConfigError(msg) from None
        self.store = get_typestore(Stores.ROS2_HUMBLE)
        for name, text in APRILTAG.items():
            self.store.register(get_types_from_msg(text, name))

    def new(self, kind: str, **fields: Any) -> Any:
        """Make a message; a field that is not given is zero or empty, as rclpy makes it."""
        missing = {name: self._zero(*what) for name, what in self.store.fielddefs[kind][1] if name not in fields}
        return self.store.types[kind](**missing, **fields)

    def _zero(self, node: Any, what: Any) -> Any:
        """Nothing, in a field as rosbags describes it."""
        if node.name == "NAME":
            return self.new(what)
        if node.name == "BASE":
            return "" if what[0] == "string" else 0.0 if what[0].startswith("float") else 0
        (inner, kind), count = what
        return np.zeros(count, dtype=kind[0]) if inner.name == "BASE" and kind[0] != "string" else []

    def octets(self, raw: bytes) -> Any:
        """Make the value of a field `uint8[]`."""
        return np.frombuffer(raw, dtype=np.uint8)

    def octet(self, value: int) -> Any:
        """Make the value of a field `byte`."""
        return int(value)


class _Aircraft:
    """The messages of one vehicle of a recording, as its gateway would have published them."""

    def __init__(self, vehicle: str, types: BagTypes, frames: Frames) -> None:
        self._newest = Newest()
        self._scene = ConversionScene(types, frames, self._newest.values, vehicle)
        self._root = f"/{name_part(vehicle)}"
        self._rows: dict[str, list[tuple[str, Ros2Topic]]] = {}
        self._reported = float("-inf")

    def messages(self, value: ExportedValue) -> Iterator[_Message]:
        """Every message that a value makes; raises `MkError` for a value that is not what its key carries."""
        rows = self._rows_of(value.suffix)
        keeps = self._newest.keeps(value.suffix)
        if not rows and not keeps:
            return
        found = _typed(value)
        for name, row in rows:
            for message in row.messages(found, self._scene):
                yield name, row.type, row.quality, message
        if keeps:
            self._newest.keep(value.suffix, found)
            yield from self._report(found.stamp)

    def _rows_of(self, suffix: str) -> list[tuple[str, Ros2Topic]]:
        if suffix not in self._rows:
            named = [(row.name_for(suffix), row) for row in TOPICS if row.is_of(suffix)]
            self._rows[suffix] = [
                (name if name.startswith("/") else f"{self._root}/{name}", row) for name, row in named
            ]
        return self._rows[suffix]

    def _report(self, now: Stamp) -> Iterator[_Message]:
        """The diagnoses of a moment, a period after the last ones."""
        if now.monotonic - self._reported >= REPORTING or now.monotonic < self._reported:
            self._reported = now.monotonic
            kind = "diagnostic_msgs/msg/DiagnosticArray"
            yield DIAGNOSTICS, kind, Quality.RELIABLE, report(self._scene, now)


def write(values: Iterable[ExportedValue], path: Path, *, overwrite: bool) -> int:
    """Write a bag, whole or not at all; returns the number of messages.

    Args:
        values: of a recording. The frames of every vehicle but the first begin with its name.
        path: folder of the bag.
        overwrite: replace a bag that is there.

    Raises:
        ConfigError: it is there already and `overwrite` is off, its folder is not there, or rosbags is not installed.
        MkError: it cannot be written, a value is not what its key carries, or nothing has a message of ROS.
    """
    types = BagTypes()
    from rosbags.rosbag2 import StoragePlugin, Writer

    if path.exists() and not overwrite:
        msg = f"{path}: already exists; choose another name, or overwrite it with --force"
        raise ConfigError(msg)
    if not path.parent.is_dir():
        msg = f"{path}: there is no folder {path.parent}; create it first"
        raise ConfigError(msg)
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as fresh:
            with Writer(Path(fresh) / path.name, version=VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
                count = _fill(writer, types, values)
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


def _fill(writer: Any, types: BagTypes, values: Iterable[ExportedValue]) -> int:
    connections: dict[str, Any] = {}
    fleet: dict[str, _Aircraft] = {}
    count = 0
    for value in values:
        if value.vehicle not in fleet:
            prefix = f"{name_part(value.vehicle)}/" if fleet else ""
            fleet[value.vehicle] = _Aircraft(value.vehicle, types, Frames(prefix))
        with expressible(value.suffix, value.vehicle, value.wall):
            for name, kind, quality, message in fleet[value.vehicle].messages(value):
                raw = types.store.serialize_cdr(message, kind)
                if name not in connections:
                    connections[name] = writer.add_connection(
                        name, kind, typestore=types.store, offered_qos_profiles=(_offered(quality),)
                    )
                writer.write(connections[name], nanoseconds(value.wall), raw)
                count += 1
    return count


def _typed(value: ExportedValue) -> Stamped:
    """The telemetry value.

    Raises:
        MkError: it is not what its key carries, or of a time that ROS cannot have.
    """
    if value.wall > LAST_SECOND:
        msg = f"{value.suffix} of {value.vehicle} is of a time after 2038, which ROS cannot have; `mkctl log cut` it"
        raise MkError(msg)
    return value.stamped


def _offered(quality: Quality) -> Any:
    """The quality of service, as a player of the bag offers it."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(0, 0)
    durability = QosDurability.TRANSIENT_LOCAL if quality.is_latched else QosDurability.VOLATILE
    kept = QosHistory.KEEP_LAST, quality.depth, QosReliability.RELIABLE, durability
    return Qos(*kept, never, never, QosLiveliness.AUTOMATIC, never, False)

"""Messages of rosbags in place of rclpy's: what a conversion makes must survive serialisation as its type."""

from __future__ import annotations

from functools import cache

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mkdaemon.gateways.ros2.messages import Scene

APRILTAG = {  # as apriltag_msgs 2.0 defines them
    "apriltag_msgs/msg/Point": "float64 x\nfloat64 y\n",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "Point centre\nPoint[4] corners\nfloat64[9] homography\n"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": "std_msgs/Header header\nAprilTagDetection[] detections\n",
}


@cache
def store():
    known = get_typestore(Stores.ROS2_JAZZY)
    for name, text in APRILTAG.items():
        known.register(get_types_from_msg(text, name))
    return known


class BagTypes:
    def new(self, kind, **fields):
        return store().types[kind](**fields)

    def octets(self, raw):
        return np.frombuffer(raw, dtype=np.uint8)

    def octet(self, value):
        return int(value)


def scene(latest=None, **more):
    return Scene(BagTypes(), latest=latest or {}, vehicle="mk1", **more)


def through_cdr(message, kind):
    """Serialise and read back: fails where a field is missing, or of another type."""
    return store().deserialize_cdr(store().serialize_cdr(message, kind), kind)

"""Messages of rosbags in place of rclpy's: what a conversion makes must survive serialisation as its type."""

from __future__ import annotations

from functools import cache

from mkdaemon.gateways.ros2 import bag
from mkdaemon.gateways.ros2.messages import ConversionScene


class BagTypes(bag.BagTypes):
    """The types of a bag, loaded once."""

    def __init__(self):
        self.store = store()


@cache
def store():
    return bag.BagTypes().store


def scene(latest=None, **more):
    return ConversionScene(BagTypes(), latest=latest or {}, vehicle="mk1", **more)


def through_cdr(message, kind):
    """Serialise and read back: fails where a field is missing, or of another type."""
    return store().deserialize_cdr(store().serialize_cdr(message, kind), kind)

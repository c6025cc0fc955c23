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


class Publisher:
    """Serialises, as rclpy does, and keeps what is published."""

    def __init__(self, kind, quality):
        self.kind, self.quality = kind, quality
        self.messages, self.readers = [], 1

    def publish(self, message):
        through_cdr(message, self.kind)
        self.messages.append(message)

    def get_subscription_count(self):
        return self.readers


class Node:
    """Keeps what is published, and lets a test be the other side."""

    def __init__(self, **given):
        self.given, self.publishers, self.subscribed, self.services = given, {}, {}, {}
        self.changed, self.asked, self.kinds, self.typed, self.declared = None, None, {}, {}, {}

    def parameters(self, table, changed, asked):
        self.changed, self.asked = changed, asked
        return {row.name: row.default for row in table} | self.given

    def publisher(self, name, kind, quality):
        if kind not in store().types or kind.startswith("apriltag_msgs"):
            return None
        return self.publishers.setdefault(name, Publisher(kind, quality))

    def subscribe(self, name, kind, arrived):
        self.subscribed[name], self.kinds[name] = arrived, kind

    def declare(self, name, value, about):
        self.declared[name] = value

    def types_published(self, name):
        return frozenset(self.typed.get(name, ()))

    def serve(self, name, kind, answer):
        self.services[name] = answer

    def sent(self, name):
        return self.publishers[name].messages if name in self.publishers else []

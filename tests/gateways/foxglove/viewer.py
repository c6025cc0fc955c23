"""A viewer that knows the public protocol and nothing of the gateway: https://github.com/foxglove/ws-protocol."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import struct
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import websockets

# Classes that come from a schema of the wire: the implementation in C has ended a whole run with a segmentation fault.
os.environ["PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION"] = "python"
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory

from lab.rigs.waiting import wait_until

SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE, TIME = 1, 2
LIST_LIMIT = 100_000


@dataclass
class Seen:
    """A message: its topic, the server's log time [ns], and what it says."""

    topic: str
    log_time: int
    value: dict[str, Any]


@cache
def message_class(name: str, schema: bytes) -> Any:
    """The class of a protobuf message, from the FileDescriptorSet that describes it."""
    files = descriptor_pb2.FileDescriptorSet.FromString(schema)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def read(schema: Any, message: bytes | None) -> dict[str, Any]:
    """A protobuf message as a map, by the schema of its channel."""
    assert message is not None
    return plain(message_class(schema.name, schema.data).FromString(message))


def plain(value: Any) -> dict[str, Any]:
    """A protobuf message as a map; fields that are zero are there."""
    return json_format.MessageToDict(value, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)


def complaints(schema: Any, path: str = "") -> Iterator[str]:
    """What Lichtblick's parser (packages/mcap-support/src/parseJsonSchema.ts) throws on in a JSON Schema."""
    if schema.get("type") != "object":
        yield f"{path}: no object"
    for name, part in schema.get("properties", {}).items():
        here = f"{path}.{name}"
        for word in ("$ref", "anyOf", "oneOf", "allOf"):
            if word in part:
                yield f"{here}: {word}"
        match part.get("type"):
            case "boolean" | "number" | "integer":
                pass
            case "string":
                if part.get("contentEncoding") not in (None, "base64"):
                    yield f"{here}: encoding"
            case "object":
                yield from complaints(part, here)
            case "array":
                item = part["items"]
                if item.get("type") == "object":
                    yield from complaints(item, f"{here}[]")
                elif item.get("type") not in {"boolean", "number", "integer", "string"} or "contentEncoding" in item:
                    yield f"{here}: array of {item.get('type')}"
            case other:
                yield f"{here}: {other}"


@dataclass
class Viewer:
    """One viewer.

    Attributes:
        info: what the server says about itself.
        channels: what it advertises, by topic.
        seen: what came, decoded.
        times: times that the server told [ns].
    """

    socket: Any
    info: dict[str, Any] = field(default_factory=dict)
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    seen: list[Seen] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    _subscriptions: dict[int, tuple[str, Any]] = field(default_factory=dict)

    async def subscribe(self, *topics: str) -> None:
        """Subscribe to topics as soon as they are advertised."""
        await wait_until(lambda: set(topics) <= self.channels.keys())
        asked = []
        for topic in topics:
            channel, number = self.channels[topic], len(self._subscriptions) + 1
            schema = base64.b64decode(channel["schema"]) if channel["encoding"] == "protobuf" else b""
            cls = message_class(channel["schemaName"], schema) if schema else None
            self._subscriptions[number] = (topic, cls)
            asked.append({"id": number, "channelId": channel["id"]})
        await self.socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    async def unsubscribe(self) -> None:
        """Unsubscribe from everything."""
        await self.socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": list(self._subscriptions)}))

    def of(self, topic: str) -> list[dict[str, Any]]:
        """What came of a topic."""
        return [one.value for one in self.seen if one.topic == topic]

    async def first(self, *topics: str) -> None:
        """Wait until something of each topic came."""
        await wait_until(lambda: all(self.of(topic) for topic in topics))

    async def read(self) -> None:
        """Read for ever."""
        async for message in self.socket:
            if isinstance(message, str):
                self._control(json.loads(message))
            elif message[0] == MESSAGE:
                number, log_time = struct.unpack_from("<IQ", message, 1)
                topic, cls = self._subscriptions[number]
                body = message[13:]
                value = json.loads(body) if cls is None else plain(cls.FromString(body))
                self.seen.append(Seen(topic, log_time, value))
                del self.seen[:-LIST_LIMIT]
            elif message[0] == TIME:
                self.times += struct.unpack_from("<Q", message, 1)

    def _control(self, message: dict[str, Any]) -> None:
        match message["op"]:
            case "serverInfo":
                self.info = message
            case "advertise":
                self.channels |= {channel["topic"]: channel for channel in message["channels"]}
            case "status":
                raise AssertionError(message)


@asynccontextmanager
async def viewing(address: str) -> AsyncIterator[Viewer]:
    """A viewer that reads while the context lasts."""
    async with websockets.connect(address, subprotocols=[SUBPROTOCOL], max_size=None) as socket:
        assert socket.subprotocol == SUBPROTOCOL
        viewer = Viewer(socket)
        reading = asyncio.create_task(viewer.read(), name="viewer")
        try:
            yield viewer
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)

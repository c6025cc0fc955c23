"""Values as JSON: what viewers show has schemas they can read, and fits them."""

from __future__ import annotations

import base64
import json

import msgpack

from mkdaemon.bus.schema import schema_json, schema_names
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.layout import ChannelFacts
from mkdaemon.record.view import JsonView, flatten_schema
from tests.record.support import sample

VIEW = JsonView(schema_json)


def entry_of(name, value, kind=EntryKind.SAMPLE):
    return sample(1, kind=kind)._replace(payload=msgpack.packb(value), encoding=f"application/msgpack;mk.{name}")


def assert_readable(schema):
    """The rules of Foxglove's parser: a type everywhere, no references, no alternatives."""
    assert isinstance(schema["type"], str)
    assert not {"$ref", "$defs", "anyOf", "oneOf", "allOf", "const", "prefixItems"} & schema.keys()
    for part in schema.get("properties", {}).values():
        assert_readable(part)
    if schema["type"] == "array":
        assert schema["items"]["type"] != "array"
        assert "contentEncoding" not in schema["items"]
        assert_readable(schema["items"])


def test_every_schema_is_readable_for_viewers():
    for name in schema_names():
        assert_readable(flatten_schema(json.loads(schema_json(name))))


def test_a_schema_that_contains_itself_ends():
    schema = {
        "$defs": {"Node": {"type": "object", "properties": {"next": {"$ref": "#/$defs/Node"}}}},
        "$ref": "#/$defs/Node",
    }
    assert_readable(flatten_schema(schema))


def test_alternatives_enums_and_constants_get_a_type():
    assert flatten_schema({"anyOf": [{"type": "null"}, {"type": "number"}], "description": "d"}) == {
        "type": "number",
        "description": "d",
    }
    assert flatten_schema({"enum": ["a", "b"]}) == {"type": "string", "enum": ["a", "b"]}
    assert flatten_schema({"const": True}) == {"type": "boolean"}
    assert flatten_schema({"type": ["null", "integer"]}) == {"type": "integer"}
    assert flatten_schema({"type": "array", "prefixItems": [{"type": "number"}]})["items"] == {"type": "number"}
    assert flatten_schema({"type": "array"})["items"] == {"type": "object"}
    nested = {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
    assert flatten_schema(nested)["items"] == {"type": "object"}
    assert flatten_schema({"type": "null"}) == {"type": "object"}


def test_bytes_become_base64_and_nulls_are_left_out():
    shown = json.loads(VIEW.show(entry_of("RawFrame.v1", {"raw": b"\x00\xff", "dropped": None, "list": [{"a": None}]})))
    assert shown == {"raw": base64.b64encode(b"\x00\xff").decode(), "list": [{}]}


def test_images_and_transforms_are_what_viewers_know():
    image = {"camera": "front", "coding": "jpeg", "pixels": b"\xff\xd8", "width": 4, "height": 3}
    entry = entry_of("CameraFrame.v1", image, EntryKind.IMAGE)
    assert VIEW.schema(ChannelFacts.of(entry))[0] == "foxglove.CompressedImage"
    shown = json.loads(VIEW.show(entry))
    assert (shown["format"], shown["frame_id"], shown["timestamp"]["sec"]) == ("jpeg", "camera/front", 1_760_001_000)
    assert VIEW.show(entry_of("CameraFrame.v1", {**image, "coding": "gray8"})) is None

    edge = {"parent": "body", "child": "camera/front", "translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]}
    entry = entry_of("Transform.v1", edge)
    name, schema = VIEW.schema(ChannelFacts.of(entry))
    assert name == "foxglove.FrameTransform"
    assert_readable(json.loads(schema))
    assert json.loads(VIEW.show(entry))["rotation"] == {"x": 0, "y": 0, "z": 0, "w": 1}


def test_what_is_no_value_of_ours_is_not_shown():
    assert VIEW.schema(ChannelFacts.of(entry_of("Gps.v1", {}, EntryKind.QUERY))) is None
    assert VIEW.schema(ChannelFacts.of(entry_of("Unknown.v9", {}))) is None
    assert VIEW.schema(ChannelFacts.of(sample(1)._replace(encoding="text/plain"))) is None
    assert VIEW.schema(ChannelFacts.of(entry_of("Gps.v1", {})))[0] == "mk.Gps.v1"
    assert VIEW.show(entry_of("Gps.v1", {})._replace(payload=b"\xc1")) is None
    assert VIEW.show(entry_of("Gps.v1", {"x": float("nan")})) is None
    assert VIEW.show(entry_of("Transform.v1", {"parent": "a"})) is None

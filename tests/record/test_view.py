"""Values as JSON, as other programs read them: schemas, the rules of viewers and the lines of Python in the docs."""

from __future__ import annotations

import json
import re
import runpy
import sys
from collections import Counter

import msgpack
import pytest
from mcap.reader import make_reader

from mkdaemon.bus.schema import schema_json
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.layout import ChannelFacts
from mkdaemon.record.reader import Recording
from mkdaemon.record.rewrite import recover
from mkdaemon.record.view import JsonView, flatten_schema
from tests.places import DATA, ROOT
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


RECORDINGS = DATA / "recordings"
FLIGHT = RECORDINGS / "nc_lost_client.mcap"
KINDS = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": (int, float)}


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A recording of the daemon with JSON for viewers: what `mkctl log repair --viewer` writes."""
    path = tmp_path_factory.mktemp("shown") / "shown.mcap"
    recover(FLIGHT, path, view=JsonView(schema_json))
    return path


def mistakes(schema, value, place="value"):
    """Where a value and a schema of a viewer's kind do not fit; a key beside its properties is one too."""
    if isinstance(value, bool) and schema["type"] != "boolean":
        yield f"{place}: {value} is no {schema['type']}"
    elif not isinstance(value, KINDS[schema["type"]]):
        yield f"{place}: {value!r} is no {schema['type']}"
    elif "enum" in schema and value not in schema["enum"]:
        yield f"{place}: {value!r} is none of {schema['enum']}"
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from mistakes(schema["items"], part, f"{place}.{number}")
    elif isinstance(value, dict) and "properties" in schema:
        for name, part in value.items():
            if name not in schema["properties"]:
                yield f"{place}.{name}: not in the schema"
            else:
                yield from mistakes(schema["properties"][name], part, f"{place}.{name}")


def test_what_viewers_show_fits_its_schema_and_stands_beside_its_original(shown):
    """PlotJuggler wants a schema for every channel and a summary; Foxglove wants JSON that its schema describes."""
    with shown.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        messages = list(reader.iter_messages(log_time_order=False))
    assert summary.statistics.message_count == len(messages)
    assert summary.chunk_indexes
    assert all(channel.schema_id in summary.schemas for channel in summary.channels.values())
    views, originals, found = Counter(), Counter(), []
    for schema, channel, message in messages:
        place = (channel.metadata["key"], message.sequence, message.log_time, message.publish_time)
        if "view" not in channel.metadata:
            originals[place] += channel.metadata["kind"] == "sample"
            continue
        assert (channel.topic, channel.message_encoding) == (channel.metadata["key"], "json")
        assert schema.encoding == "jsonschema"
        views[place] += 1
        found += [f"{channel.topic}: {one}" for one in mistakes(json.loads(schema.data), json.loads(message.data))]
    assert found == []
    assert {place for place in views if "/setpoint/" not in place[0]} == {
        place for place, many in originals.items() if many
    }


def test_the_lines_of_python_in_the_docs_read_a_recording(monkeypatch, capsys, tmp_path):
    page = (ROOT / "docs" / "recording.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(code.splitlines()) <= 20
    script = tmp_path / "read.py"
    script.write_text(code, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["read.py", str(FLIGHT)])
    runpy.run_path(str(script))
    lines = capsys.readouterr().out.splitlines()
    entries = list(Recording(FLIGHT).entries(lambda facts: facts.kind is EntryKind.SAMPLE))
    assert len(lines) == len(entries)
    assert [line.split()[1] for line in lines] == [
        entry.key for entry in sorted(entries, key=lambda one: one.base.file_time(one.received))
    ]

"""Topics: schemas that viewers can read, keys that exist, no key without one, and layouts that name what is there."""

from __future__ import annotations

import json
import re

import pytest
import zenoh

from mkdaemon.bus.keys import KEYS, Use
from mkdaemon.client.patterns import is_known
from mkdaemon.gateways.foxglove.topics import (
    CAMERA,
    SHOWN_OTHERWISE,
    TOPICS,
    json_keys,
    json_schema,
)
from tests.gateways.foxglove.viewer import complaints, message_class
from tests.places import ROOT


@pytest.mark.parametrize("topic", TOPICS, ids=lambda one: one.name)
def test_every_topic_has_a_schema_that_can_be_read_and_keys_that_exist(topic):
    schema = topic.schema()
    if topic.encoding == "protobuf":
        assert schema.encoding == "protobuf"
        assert message_class(schema.name, schema.data).DESCRIPTOR.full_name == schema.name
    else:
        assert list(complaints(json.loads(schema.data))) == []
    for key in topic.of("down").keys:
        assert is_known(key)
        assert CAMERA not in key


def test_names_are_one_each_and_an_unknown_schema_has_no_fields():
    assert json.loads(json_schema("Newer.v9").data) == {"type": "object"}
    assert json_schema(None).name == "mk.unknown"
    names = [topic.name for topic in TOPICS] + [f"/{key}" for key, _ in json_keys()]
    assert len(names) == len(set(names))


def test_every_key_that_is_published_is_shown_in_some_way():
    shown = {key for key, _ in json_keys()}
    typed = [zenoh.KeyExpr(key) for topic in TOPICS for key in topic.of("x").keys]
    for spec in KEYS:
        if spec.use is Use.PUBLISHED and spec.suffix.partition("/")[0] not in {"rx", "tx"}:
            is_typed = any(key.intersects(zenoh.KeyExpr(spec.pattern)) for key in typed)
            assert spec.suffix in shown or (spec.suffix in SHOWN_OTHERWISE and (is_typed or spec.suffix == "tf"))
    assert not {key for key in shown if key.split("/")[0] in {"do", "cmd", "schema", "alive", "client"}}


LAYOUTS = sorted((ROOT / "configs" / "foxglove").glob("*.json"))
TYPED = {(topic.of("down") if topic.is_of_a_camera else topic).name for topic in TOPICS}
JSON_KEYS = {f"/{key.replace(CAMERA, 'down')}": schema for key, schema in json_keys()}


def texts(part):
    """Every text and every name in a layout."""
    if isinstance(part, dict):
        yield from part
        part = list(part.values())
    if isinstance(part, list):
        for one in part:
            yield from texts(one)
    elif isinstance(part, str):
        yield part


def panels(split):
    """The panels in a split of the screen."""
    if isinstance(split, str):
        return {split}
    return panels(split["first"]) | panels(split["second"])


def follow(schema, path):
    """The part of a schema that a path of a viewer leads to."""
    for name, index in re.findall(r"\.(\w+)|\[(\d+)\]", path):
        schema = schema["properties"][name] if name else schema["items"]
        assert index == "" or "type" in schema
    return schema


@pytest.mark.parametrize("file", LAYOUTS, ids=lambda file: file.stem)
def test_a_layout_names_what_is_there(file):
    layout = json.loads(file.read_text(encoding="utf-8"))
    assert panels(layout["layout"]) == set(layout["configById"])
    named = {text for text in texts(layout["configById"]) if text.startswith("/")}
    assert len(named) > 5
    for text in named:
        topic, path = re.fullmatch(r"([^.\[]+)(.*)", text).groups()
        if path:
            assert follow(json.loads(json_schema(JSON_KEYS[topic]).data), path)["type"] in {
                "number",
                "integer",
                "string",
            }
        else:
            assert topic in TYPED | JSON_KEYS.keys()

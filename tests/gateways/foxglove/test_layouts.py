"""The layouts name topics that are there, and fields that they have."""

from __future__ import annotations

import json
import re

import pytest

from mkdaemon.gateways.foxglove.topics import CAMERA, TOPICS, json_keys, json_schema
from tests.places import ROOT

LAYOUTS = sorted((ROOT / "configs" / "foxglove").glob("*.json"))
TYPED = {(topic.of("down") if topic.is_of_a_camera else topic).name for topic in TOPICS}
KEYS = {f"/{key.replace(CAMERA, 'down')}": schema for key, schema in json_keys()}


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
            assert follow(json.loads(json_schema(KEYS[topic]).data), path)["type"] in {"number", "integer", "string"}
        else:
            assert topic in TYPED | KEYS.keys()

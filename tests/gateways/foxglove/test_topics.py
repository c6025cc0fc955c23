"""Topics: schemas that viewers can read, keys that exist, and no key without one."""

from __future__ import annotations

import json

import pytest
import zenoh

from mkdaemon.bus.keys import KEYS, Use
from mkdaemon.client.patterns import is_known
from mkdaemon.gateways.foxglove.topics import CAMERA, SHOWN_OTHERWISE, TOPICS, json_keys, json_schema
from tests.gateways.foxglove.viewer import complaints, message_class


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

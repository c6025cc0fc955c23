"""The table of keys: what is found in it, and that it can be published and asked for."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import get_args, get_origin

import pytest
import zenoh
from pydantic import BaseModel

from mkdaemon.bus.codec import schema_name
from mkdaemon.bus.keys import KEYS, Use, find, of_use, roots
from mkdaemon.bus.names import key, suffix_of
from mkdaemon.bus.schema import schema_json, schema_names
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.traffic import FrameSample


def test_every_line_is_a_key_expression_with_a_schema():
    for spec in KEYS:
        zenoh.KeyExpr(key("mk1", spec.pattern))
        assert find(spec.suffix.replace("<", "").replace(">", "")) is spec
        assert spec.about.endswith(".")
        assert not any(chunk.startswith("@") for chunk in spec.suffix.split("/")), "it would hide from wildcards"
        assert bool(spec.when) == (spec.use in {Use.PUBLISHED, Use.CLIENT})
        if spec.carries is not None:
            schema = json.loads(schema_json(schema_name(spec.carries)))
            undescribed = [name for name, field in schema.get("properties", {}).items() if not field.get("description")]
            assert undescribed == [], f"{spec.suffix}: a field without a word on its meaning and unit"


def keys_of_maps(annotation: object) -> Iterator[object]:
    """Types of the keys of every map in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for field in annotation.model_fields.values():
            yield from keys_of_maps(field.annotation)
        return
    parts = get_args(annotation)
    if parts and get_origin(annotation) in (dict, Mapping):
        yield parts[0]
    for part in parts:
        yield from keys_of_maps(part)


def test_keys_of_maps_are_words():
    """Readers of msgpack take no others, and JSON has none."""
    kinds = {(spec.suffix, kind) for spec in KEYS if spec.carries for kind in keys_of_maps(spec.carries)}
    assert not [(suffix, kind) for suffix, kind in kinds if not (isinstance(kind, type) and issubclass(kind, str))]


def test_no_two_lines_claim_the_same_key():
    patterns = [zenoh.KeyExpr(spec.pattern) for spec in KEYS]
    clashes = [(str(a), str(b)) for n, a in enumerate(patterns) for b in patterns[n + 1 :] if a.intersects(b)]
    assert clashes == []


def test_keys_are_found_by_their_suffix_and_those_of_other_vehicles_and_unknown_ones_are_none():
    assert (find("state/attitude").carries, find("rx/nc/osd").carries) == (Attitude, FrameSample)
    assert suffix_of("mk1", key("mk1", "state/battery")) == "state/battery"
    with pytest.raises(ValueError, match="not a key of vehicle mk1"):
        suffix_of("mk1", "mk/mk10/state/battery")
    assert [find(suffix) for suffix in ("state/nothing", "state", "rx/nc/osd/more", "state/attitude/more")] == [
        None
    ] * 4
    assert schema_json("Nothing.v1") is None
    assert "OsdData5.v1" in schema_names()
    assert len(schema_names()) == len(set(schema_names()))


def test_the_daemon_answers_for_the_roots_it_publishes():
    assert {"raw", "rx", "tx", "state", "link", "event", "health"} <= set(roots(Use.PUBLISHED))
    assert "sim" not in roots(Use.PUBLISHED)
    assert all(spec.use is Use.QUERY for spec in of_use(Use.QUERY))

"""The page of every configuration key."""

from __future__ import annotations

import json
import tomllib

import pytest
from pydantic import BaseModel

from mkdaemon.cli.mkdaemon.documentedfiles import documented_files
from mkdaemon.config.keys import keys_of
from mkdaemon.config.root import DaemonSections
from mksim.config import SimulatorFile
from tests.places import CONFIGS, ROOT
from tools.docs import make_page

FILES = [file.model for file in documented_files()]


@pytest.fixture(scope="module")
def keys():
    """Every key of every file."""
    return [key for model in FILES for key in keys_of(model)]


def leaves(schema, part):
    """Every key of a JSON schema that holds no section, counted as often as it can be written."""
    if "$ref" in part:
        part = schema["$defs"][part["$ref"].rsplit("/", 1)[1]]
    if "properties" in part:
        return sum(leaves(schema, field) for field in part["properties"].values())
    inner = [part["items"]] if "items" in part else part.get("anyOf", part.get("allOf", []))
    found = max((leaves(schema, one) for one in inner), default=1)
    return max(found, 1)


@pytest.mark.parametrize("model", FILES, ids=lambda model: model.__name__)
def test_no_key_is_left_out(model: type[BaseModel]):
    schema = model.model_json_schema()
    assert len(list(keys_of(model))) == leaves(schema, schema)


def test_every_key_has_type_default_and_meaning(keys):
    assert keys
    for key in keys:
        name = f"{key.section}.{key.name}"
        assert key.kind, name
        assert key.default, name
        assert len(key.meaning) > 3, name
        assert not key.meaning.startswith("."), name


def test_every_key_of_the_aircraft_says_what_a_wrong_value_does():
    keys = list(keys_of(DaemonSections))
    assert keys
    assert [key.dotted for key in keys if len(key.consequence) < 10] == []
    assert [key.dotted for key in keys if not key.consequence.endswith(".")] == []


def test_units_ranges_and_defaults_are_told(keys):
    cells = {key.dotted: (key.kind, key.unit, key.default, key.limits) for key in keys}
    assert cells["link.gap_ms"][:4] == ("number", "ms", "`12.0`", ">= 2.25, <= 100")
    assert cells["control.rate"][1:3] == ("Hz", "`50.0`")
    assert cells["sim.pilot_plan"][0].startswith("`circle`, `hover`")
    assert cells["sim.radio.to_host.usb_timer"][2] == "`0.001`", "the default of this direction, not of the model"
    assert cells["targets.tags.size"][2] == "*required*"
    assert cells["cameras.calibration"][2] == "unset"


def test_the_page_shows_every_section_of_the_samples():
    page = make_page("docs/configuration.md", ROOT)
    sections = set()
    for file in CONFIGS.glob("*.toml"):
        tree = tomllib.loads(file.read_text(encoding="utf-8"))
        sections |= {name for name in tree if isinstance(tree[name], dict)}
    assert sections
    assert [name for name in sections if f"### `[{name}]`" not in page] == []
    assert json.dumps(SimulatorFile().bus.listen[0]) in page

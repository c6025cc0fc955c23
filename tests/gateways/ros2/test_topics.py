"""The table of topics: keys and types exist, and docs/ros.md names each, with every service and parameter."""

from __future__ import annotations

import re

from mkdaemon.bus.keys import KEYS
from mkdaemon.gateways.ros2 import topics
from mkdaemon.gateways.ros2.parameters import PARAMETERS, RATES
from mkdaemon.gateways.ros2.services import SERVICES
from mkdaemon.gateways.ros2.topics import TOPICS, Quality
from tests.gateways.ros2.bagtypes import store
from tests.places import DOCS


def test_every_row_is_of_a_key_and_a_type_that_exist_and_rows_of_one_topic_agree():
    known = {spec.suffix.replace("<camera>", "*") for spec in KEYS}
    assert {row.key for row in TOPICS} <= known
    assert set(topics.KEPT) <= known
    assert {row.type for row in TOPICS} <= set(store().types)
    for name in {row.name for row in TOPICS}:
        assert len({(row.type, row.quality) for row in TOPICS if row.name == name}) == 1


PAGE = (DOCS / "ros.md").read_text(encoding="utf-8").split("\n## Reference\n")[1]
QUALITIES = {Quality.SENSOR: "stream", Quality.RELIABLE: "event", Quality.LATCHED: "latched", Quality.TREE: "tree"}
CELLS = {
    cells[0].strip("`"): cells[1:]
    for cells in (re.findall(r" ([^|]*?) \|", line) for line in PAGE.splitlines())
    if cells
}


def test_every_topic_stands_there_with_its_type_frame_quality_keys_and_rates():
    when = {spec.suffix: spec.when for spec in KEYS}
    for name in {row.name for row in TOPICS}:
        rows = [row for row in TOPICS if row.name == name]
        keys = list(dict.fromkeys(row.key.replace("*", "<camera>") for row in rows))
        kind, frame, quality, source, _ = CELLS[name.replace("{camera}", "<camera>")]
        assert (kind, frame.strip("`")) == (rows[0].type.replace("/msg", ""), rows[0].frame), name
        assert quality == QUALITIES[rows[0].quality], name
        assert source == "; ".join(f"`{key}`, {when[key]}" for key in keys), name


def test_every_service_stands_there_with_its_type_and_every_parameter_with_its_default():
    assert {service.name: CELLS[service.name][0] for service in SERVICES} == {
        service.name: service.type.replace("/srv", "") for service in SERVICES
    }
    for row in PARAMETERS:
        if row.name.startswith(RATES) or row.name in {"joy.axes", "joy.buttons", "topics"}:
            continue
        words = str(row.default).lower() if isinstance(row.default, bool) else str(row.default)
        assert re.search(rf"^\| `{re.escape(row.name)}` \| `?{re.escape(words)}`? \|", PAGE, re.MULTILINE), row.name

"""Files as other programs read them: the rules of viewers, and the lines of Python in docs/recording.md."""

from __future__ import annotations

import json
import re
import runpy
import sys
from collections import Counter

import pytest
from mcap.reader import make_reader

from mkdaemon.bus.schema import schema_json
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.reader import Recording
from mkdaemon.record.rewrite import recover
from mkdaemon.record.view import JsonView
from tests.places import DATA, ROOT

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

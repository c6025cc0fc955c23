"""A recording for viewers and a bag of ROS: what the live gateways would have sent, read back with other libraries."""

from __future__ import annotations

import json
import re
from collections import Counter

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from mkdaemon.bus.codec import schema_name
from mkdaemon.cli.mkctl.export import export
from mkdaemon.client.export.values import ExportedValue, read_values
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.foxglove import recording
from mkdaemon.gateways.ros2 import bag
from mkdaemon.gateways.ros2.topics import TOPICS
from tests import samples
from tests.gateways.foxglove.viewer import read
from tests.places import CONFIGS, DATA

OVER_TARGET = DATA / "recordings" / "fc_over_target.mcap"
BY_GPS = DATA / "recordings" / "nc_lost_client.mcap"
LAYOUT = (CONFIGS / "foxglove" / "flight.json").read_text(encoding="utf-8")
OF_FLIGHT = {"/scene", "/pose", "/fix", "/home", "/log", "/diagnostics"}
"""Topics of the layout of a flight that are no key."""
WRITERS = pytest.mark.parametrize("write", [recording.write, bag.write], ids=["foxglove", "ros2"])
WIDE = samples.setup(lens=samples.LENS.model_copy(update={"width": 1 << 64}))
"""No message has room for the width of this camera."""


def value(suffix, model, vehicle="mk1"):
    fields, schema = model.model_dump(), schema_name(type(model))
    return ExportedValue(vehicle, suffix, model.stamp.wall, model.stamp.monotonic, fields, schema)


def broken(suffix, schema, fields):
    """A value that is not what its key carries."""
    return ExportedValue("mk1", suffix, 1.7e9, 5.0, {"stamp": samples.stamp().model_dump()} | fields, schema)


GOOD = value("state/attitude", samples.attitude())


def shown(path):
    """(topic, log time [ns], what it says) of every message for viewers, in the order of the log times."""
    with path.open("rb") as file:
        return [
            (channel.topic, message.log_time, json.loads(message.data))
            if channel.message_encoding == "json"
            else (channel.topic, message.log_time, read(schema, message.data))
            for schema, channel, message in make_reader(file).iter_messages()
        ]


def in_bag(folder):
    """(topic, type, message) in the bag's order, and the offered reliability and durability of each topic."""
    with AnyReader([folder]) as reader:
        found = [(c.topic, c.msgtype, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    return found, offered


def written(values, folder):
    """A bag of values, read."""
    bag.write(values, folder / "bag", overwrite=False)
    return in_bag(folder / "bag")


@WRITERS
def test_it_is_only_replaced_by_force(tmp_path, write):
    count = write([GOOD], tmp_path / "out", overwrite=False)
    with pytest.raises(ConfigError, match="--force"):
        write([GOOD], tmp_path / "out", overwrite=False)
    assert write([GOOD], tmp_path / "out", overwrite=True) == count > 1
    with pytest.raises(ConfigError, match=r"no (such )?folder"):
        write([GOOD], tmp_path / "no" / "out", overwrite=False)


NOT_CARRIED = [
    broken("state/attitude", "Attitude.v1", {"quaternion": [1.0, 0.0]}),
    broken("state/battery", "Battery.v1", {"voltage": b"12"}),
    broken("state/position", "Position.v1", {"latitude_deg": float("nan")}),
    broken("tf", "Transform.v1", {"parent": "a", "child": 3}),
    broken("control/output", "ControlOutput.v7", {"pitch": 1}),
]


@pytest.mark.parametrize(
    ("write", "values", "words"),
    [
        (recording.write, [], "nothing to export"),
        (recording.write, [GOOD, NOT_CARRIED[2]], r"state/position of mk1 at .*--format csv takes every value"),
        *((bag.write, [one], f"{one.suffix} of mk1 at .*--format csv takes every value") for one in NOT_CARRIED),
        *((write, [value("vision/down/setup", WIDE)], "fits in no message") for write in (recording.write, bag.write)),
        (bag.write, [value("link/traffic", samples.attitude())], "nothing in the recording"),
        (bag.write, [value("state/battery", samples.battery(1.4e9))], "after 2038"),
    ],
)
def test_what_cannot_be_written_is_named_and_leaves_nothing(tmp_path, write, values, words):
    with pytest.raises(MkError, match=words):
        write(values, tmp_path / "out", overwrite=False)
    assert list(tmp_path.iterdir()) == []


def test_the_layout_of_a_flight_finds_its_topics_in_an_exported_recording_with_its_times_and_numbers(tmp_path):
    found = {}
    for path in (OVER_TARGET, BY_GPS):
        export(path, to="foxglove", output=tmp_path / path.name)
        found[path] = shown(tmp_path / path.name)
    by_target, by_gps = ({topic for topic, *_ in found[path]} for path in (OVER_TARGET, BY_GPS))
    wanted = set(re.findall(r"\"(/[a-z_/]+?)[\".]", LAYOUT))
    assert wanted >= OF_FLIGHT and wanted - by_target - by_gps == set()
    assert {"/scene", "/tf", "/pose", "/log", "/camera/down/image", "/camera/down/annotations"} <= by_target
    assert not {"/tf", "/vision/down/image"} & {topic for topic in by_gps if topic.startswith("/vision")}
    recorded = list(read_values(BY_GPS))
    positions = [one for one in recorded if one.suffix == "state/position"]
    fixes = [(at, one["latitude"]) for topic, at, one in found[BY_GPS] if topic == "/fix"]
    assert [latitude for _, latitude in fixes] == [one.fields["latitude_deg"] for one in positions]
    assert [at / 1e9 for at, _ in fixes] == pytest.approx([one.wall for one in positions])
    counts = Counter(topic for topic, *_ in found[BY_GPS])
    assert counts["/state/attitude"] == sum(one.suffix == "state/attitude" for one in recorded) == 12
    assert counts["/home"] == 1


def test_a_bag_has_every_topic_with_its_type_quality_and_frame_of_the_tree(tmp_path):
    found, offered = written([value(suffix, model) for suffix, model in samples.EVERY], tmp_path)
    names = {row.name.format(camera="down"): row for row in TOPICS}
    wanted = {name if name.startswith("/") else f"/mk1/{name}": row for name, row in names.items()}
    types = {name: row.type for name, row in wanted.items()} | {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
    assert {topic: kind for topic, kind, _ in found} == types
    for name, row in wanted.items():
        assert offered[name].depth == row.quality.depth, name
        assert offered[name].reliability.name == "RELIABLE", name
        assert (offered[name].durability.name == "TRANSIENT_LOCAL") == row.quality.is_latched, name
    trees = [message.transforms for topic, _, message in found if topic in {"/tf", "/tf_static"}]
    tree = {one.child_frame_id: one.header.frame_id for each in trees for one in each}
    camera = "down_optical_frame"
    assert tree == {"odom": "map", "base_link": "odom", camera: "base_link", "target/pad": camera}
    for topic, _, message in found:
        if topic in wanted and wanted[topic].frame:
            frame = wanted[topic].frame.replace("<camera>", "down").replace("<name>", "pad")
            assert message.header.frame_id == frame, topic
            assert frame in {*tree, "map"}, topic

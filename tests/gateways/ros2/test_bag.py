"""A recording as a bag: the topics, types and frames of the live gateway, read back with rosbags."""

from __future__ import annotations

import pytest
from rosbags.highlevel import AnyReader

from mkdaemon.bus.codec import schema_name
from mkdaemon.client.export.values import ExportedValue, read_values
from mkdaemon.errors import MkError
from mkdaemon.gateways.ros2.bag import write
from mkdaemon.gateways.ros2.messages import name_part
from mkdaemon.gateways.ros2.topics import TOPICS
from tests import samples
from tests.places import DATA

FLIGHT = DATA / "recordings" / "fc_over_target.mcap"


def value(suffix, model, vehicle="mk1"):
    fields, schema = model.model_dump(), schema_name(type(model))
    return ExportedValue(vehicle, suffix, model.stamp.wall, model.stamp.monotonic, fields, schema)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag with every value, read."""
    folder = tmp_path_factory.mktemp("every") / "bag"
    write([value(suffix, model) for suffix, model in samples.EVERY], folder, overwrite=False)
    return read(folder)


def read(folder):
    """(topic, type, message) in the bag's order, and the offered reliability and durability of each topic."""
    with AnyReader([folder]) as reader:
        found = [(c.topic, c.msgtype, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    return found, offered


def test_a_bag_has_every_topic_of_the_gateway_with_its_type_and_quality(bag):
    found, offered = bag
    wanted = {}
    for row in TOPICS:
        name = row.name.format(camera="down")
        wanted[name if name.startswith("/") else f"/mk1/{name}"] = row
    assert {topic: kind for topic, kind, _ in found} == {name: row.type for name, row in wanted.items()} | {
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"
    }
    for name, row in wanted.items():
        assert offered[name].depth == row.quality.depth, name
        assert offered[name].reliability.name == "RELIABLE", name
        assert (offered[name].durability.name == "TRANSIENT_LOCAL") == row.quality.is_latched, name


def test_every_frame_of_a_header_is_one_that_the_table_names_and_the_tree_holds(bag):
    found, _ = bag
    tree = {}
    for topic, _, message in found:
        if topic in {"/tf", "/tf_static"}:
            tree |= {one.child_frame_id: one.header.frame_id for one in message.transforms}
    assert tree == {
        "odom": "map",
        "base_link": "odom",
        "down_optical_frame": "base_link",
        "target/pad": "down_optical_frame",
    }
    frames = {f"/mk1/{row.name.format(camera='down')}": row.frame for row in TOPICS if row.frame}
    for topic, _, message in found:
        if topic in frames:
            assert message.header.frame_id == frames[topic].replace("<camera>", "down").replace("<name>", "pad"), topic
            assert message.header.frame_id in {*tree, "map"}, topic


def test_diagnoses_come_once_a_second_of_the_recording(tmp_path):
    values = [value("state/battery", samples.battery(n * 0.05)) for n in range(50)]  # 2.45 s: at 0, 1 and 2 s
    write(values, tmp_path / "bag", overwrite=False)
    assert sum(topic == "/diagnostics" for topic, *_ in read(tmp_path / "bag")[0]) == 3


def test_a_recorded_flight_has_its_images_and_its_odometry(tmp_path):
    values = list(read_values(FLIGHT, images=True))
    write(values, tmp_path / "bag", overwrite=False)
    found, _ = read(tmp_path / "bag")
    root = f"/{name_part(values[0].vehicle)}"

    def count(topic):
        return sum(one == f"{root}/{topic}" for one, *_ in found)

    assert count("odom") == sum(one.suffix == "control/estimate" for one in values) > 40
    assert count("down/image") + count("down/image/compressed") >= 29
    assert count("battery_state") == 34


@pytest.mark.parametrize(
    ("suffix", "schema", "fields"),
    [
        ("state/attitude", "Attitude.v1", {"quaternion": [1.0, 0.0]}),
        ("state/battery", "Battery.v1", {"voltage": b"12"}),
        ("state/position", "Position.v1", {"latitude_deg": float("nan")}),
        ("tf", "Transform.v1", {"parent": "a", "child": 3}),
        ("control/output", "ControlOutput.v7", {"pitch": 1}),
    ],
)
def test_a_value_that_is_not_what_its_key_carries_and_a_time_that_ros_cannot_have_are_named(
    tmp_path, suffix, schema, fields
):
    nothing = value("link/traffic", samples.attitude())
    broken = ExportedValue("mk1", suffix, 1.7e9, 5.0, {"stamp": samples.stamp().model_dump()} | fields, schema)
    late = value("state/battery", samples.battery(1.4e9))
    for one, words in (
        (broken, f"{suffix} of mk1 at .*--format csv takes every value"),
        (late, "after 2038"),
        (nothing, "nothing in the recording"),
    ):
        with pytest.raises(MkError, match=words):
            write([one], tmp_path / "bag", overwrite=False)
    assert list(tmp_path.iterdir()) == []

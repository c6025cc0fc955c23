"""A recording for viewers and a bag of ROS: whole or not there, replaced only by force, each vehicle by itself."""

from __future__ import annotations

from dataclasses import replace

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from mkdaemon.bus.codec import schema_name
from mkdaemon.client.export.values import ExportedValue
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.foxglove import recording
from mkdaemon.gateways.ros2 import bag
from tests import samples

WRITERS = pytest.mark.parametrize("write", [recording.write, bag.write], ids=["foxglove", "ros2"])
WIDE = samples.setup(lens=samples.LENS.model_copy(update={"width": 1 << 64}))
"""No message has room for the width of this camera."""


def value(suffix, model, vehicle="mk1"):
    fields, schema = model.model_dump(mode="json"), schema_name(type(model))
    return ExportedValue(vehicle, suffix, model.stamp.wall, model.stamp.monotonic, fields, schema)


GOOD = value("state/attitude", samples.attitude())


@WRITERS
def test_it_is_only_replaced_by_force(tmp_path, write):
    count = write([GOOD], tmp_path / "out", overwrite=False)
    with pytest.raises(ConfigError, match="--force"):
        write([GOOD], tmp_path / "out", overwrite=False)
    assert write([GOOD], tmp_path / "out", overwrite=True) == count > 1
    with pytest.raises(ConfigError, match=r"no (such )?folder"):
        write([GOOD], tmp_path / "no" / "out", overwrite=False)


@WRITERS
@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([], "nothing"),
        (
            [GOOD, ExportedValue("mk1", "state/position", 1.7e9, 1.0, {"latitude_deg": "north"}, "Position.v1")],
            r"state/position of mk1 at .*--format csv takes every value",
        ),
        ([value("vision/down/setup", WIDE)], r"vision/down/setup of mk1 at .* fits in no message .*format csv"),
    ],
    ids=["nothing", "no position", "too wide a camera"],
)
def test_what_cannot_be_written_is_named_and_leaves_nothing(tmp_path, write, values, words):
    with pytest.raises(MkError, match=words):
        write(values, tmp_path / "out", overwrite=False)
    assert list(tmp_path.iterdir()) == []


def test_a_second_vehicle_has_topics_and_frames_of_its_own(tmp_path):
    both = [GOOD, replace(GOOD, vehicle="mk-2")]
    recording.write(both, tmp_path / "both.mcap", overwrite=False)
    with (tmp_path / "both.mcap").open("rb") as file:
        topics = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert {"/state/attitude", "/tf", "/mk-2/state/attitude", "/mk-2/tf"} <= topics
    bag.write(both, tmp_path / "bag", overwrite=False)
    with AnyReader([tmp_path / "bag"]) as reader:
        found = [(one.topic, reader.deserialize(raw, one.msgtype)) for one, _, raw in reader.messages()]
    frames = {topic: message.header.frame_id for topic, message in found if "imu" in topic}
    assert frames == {"/mk1/imu": "base_link", "/mk_2/imu": "mk_2/base_link"}

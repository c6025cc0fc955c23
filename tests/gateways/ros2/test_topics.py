"""The table of topics: every key exists, every type is known, and every value that is published has its row tried."""

from __future__ import annotations

from mkdaemon.bus.keys import KEYS
from mkdaemon.gateways.ros2 import topics
from mkdaemon.gateways.ros2.topics import TOPICS, Newest, Ros2Topic
from tests import samples
from tests.gateways.ros2.bagtypes import store


def test_every_row_is_of_a_key_that_is_published_and_a_type_that_exists():
    known = {spec.suffix.replace("<camera>", "*") for spec in KEYS}
    assert {row.key for row in TOPICS} <= known
    assert set(topics.KEPT) <= known
    assert {row.type for row in TOPICS} <= set(store().types)


def test_rows_of_one_topic_agree_about_type_and_quality():
    for name in {row.name for row in TOPICS}:
        assert len({(row.type, row.quality) for row in TOPICS if row.name == name}) == 1


def test_a_camera_gives_its_topics_their_name():
    (row,) = (row for row in TOPICS if row.name == "{camera}/image")
    assert row.name_for("vision/front-left/image") == "front_left/image"
    assert row.is_of("vision/down/image")
    assert not row.is_of("vision/down/pose")
    assert row.word == "image"
    assert Ros2Topic("/tf", "tf", "", lambda *_: None).word == "tf"


def test_newest_values_and_every_mount_are_kept():
    newest = Newest()
    assert newest.keeps("vision/down/stats")
    assert not newest.keeps("raw/rx")
    newest.keep("state/attitude", samples.attitude())
    newest.keep("tf", samples.edge())
    newest.keep("tf", samples.edge())
    newest.keep("tf", samples.edge(child="camera/front"))
    newest.keep("tf", samples.edge(parent="camera/down", child="pad", static=False))
    assert newest.values["state/attitude"] == samples.attitude()
    assert [mount.child for mount in newest.values["mounts"]] == ["camera/down", "camera/front"]

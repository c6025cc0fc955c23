"""A recording for viewers: what the shipped layouts look at is in the file, as the gateway would have sent it."""

from __future__ import annotations

import json
import re
from collections import Counter

import pytest
from mcap.reader import make_reader

from mkdaemon.cli.mkctl.export import export
from mkdaemon.client.export.values import read_values
from tests.gateways.foxglove.viewer import read
from tests.places import CONFIGS, DATA

OVER_TARGET = DATA / "recordings" / "fc_over_target.mcap"
BY_GPS = DATA / "recordings" / "nc_lost_client.mcap"
LAYOUT = (CONFIGS / "foxglove" / "flight.json").read_text(encoding="utf-8")
OF_FLIGHT = {"/scene", "/pose", "/fix", "/home", "/log", "/diagnostics"}
"""Topics of the layout of a flight that are no key."""


def messages_of(path):
    """(topic, log time [ns], what it says) of every message, in the order of the log times."""
    with path.open("rb") as file:
        return [
            (channel.topic, message.log_time, json.loads(message.data))
            if channel.message_encoding == "json"
            else (channel.topic, message.log_time, read(schema, message.data))
            for schema, channel, message in make_reader(file).iter_messages()
        ]


def exported(recording, folder):
    export(recording, to="foxglove", output=folder / "shown.mcap")
    return messages_of(folder / "shown.mcap")


def test_the_layout_of_a_flight_finds_its_topics_in_an_exported_recording(tmp_path):
    wanted = set(re.findall(r"\"(/[a-z_/]+?)[\".]", LAYOUT))
    assert wanted >= OF_FLIGHT
    by_target = {topic for topic, *_ in exported(OVER_TARGET, tmp_path)}
    (tmp_path / "shown.mcap").unlink()
    by_gps = {topic for topic, *_ in exported(BY_GPS, tmp_path)}
    assert wanted - by_target - by_gps == set()
    assert {"/scene", "/tf", "/pose", "/log", "/camera/down/image", "/camera/down/annotations"} <= by_target


def test_messages_have_the_times_and_numbers_of_the_recording(tmp_path):
    found = exported(BY_GPS, tmp_path)
    positions = [one for one in read_values(BY_GPS) if one.suffix == "state/position"]
    fixes = [(at, one["latitude"]) for topic, at, one in found if topic == "/fix"]
    assert [latitude for _, latitude in fixes] == [one.fields["latitude_deg"] for one in positions]
    assert [at / 1e9 for at, _ in fixes] == pytest.approx([one.wall for one in positions])
    counts = Counter(topic for topic, *_ in found)
    assert counts["/state/attitude"] == sum(one.suffix == "state/attitude" for one in read_values(BY_GPS)) == 12
    assert counts["/home"] == 1
    assert not {"/tf", "/vision/down/image"} & {topic for topic, *_ in found if topic.startswith("/vision")}

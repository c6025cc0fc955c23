"""A value that a stranger puts, whole by its schema, ends the message that is made of it, never a gateway."""

from __future__ import annotations

import random
from contextlib import suppress

from foxglove import Context
from foxglove.channel import Channel
from pydantic import ValidationError

from mkdaemon.bus.codec import encoding_of
from mkdaemon.client import Sample
from mkdaemon.gateways.foxglove.exhibit import Exhibit
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.gateways.ros2.gateway import Publishing
from mkdaemon.gateways.ros2.messages import ConversionScene
from mkdaemon.gateways.ros2.parameters import Pace
from mkdaemon.gateways.ros2.topics import TOPICS, Newest
from mkdaemon.reading import Reading
from mkdaemon.reading.known import MOST_CAMERAS
from mkdaemon.telemetry.state import Position
from tests import samples
from tests.gateways.mavlink.rig import ATTITUDE, beat, virtually
from tests.gateways.ros2.bagtypes import BagTypes, Node
from tests.reading.knownflight import KNOWN

COUNT = 200
WIDE = samples.setup().model_copy(update={"lens": samples.setup().lens.model_copy(update={"width": 1 << 64})})
"""No message has room for the width of this camera."""


def sample_of(key, value):
    """A sample with its value, which no schema need take."""
    sample = Sample(key, value.model_dump(mode="json", exclude={"pixels"}), encoding_of(type(value)))
    sample.__dict__["value"] = value
    return sample


def test_ros_goes_on_publishing():
    graph, newest = Node(), Newest()
    publishing = Publishing(
        graph, TOPICS, ConversionScene(BagTypes(), latest=newest.values, vehicle="mk1"), newest, Pace({})
    )

    for key, value in (("vision/down/setup", WIDE), *strange(COUNT)):
        publishing.take(sample_of(key, value))
    assert publishing.faults.count > 0
    before = len(graph.sent("imu"))
    publishing.take(sample_of("state/attitude", samples.attitude()))
    assert len(graph.sent("imu")) == before + 1


async def test_foxglove_goes_on_showing(monkeypatch):
    shown = []
    monkeypatch.setattr(Channel, "log", lambda channel, message, **_: shown.append(channel.topic()))
    exhibit = Exhibit(Context(), Names("mk1"), lambda now: None)
    exhibit._add_camera("down")
    try:
        for number in exhibit.lines:
            exhibit.subscribed(number, 1)
        for key, value in (("vision/down/setup", WIDE), *strange(COUNT, seed=2)):
            exhibit._take(sample_of(key, value))
        assert exhibit.faults.count > 0
        for odd in ("x", [], None, True, float("nan"), float("inf"), -1e308, 1e308, 2**70):
            for name in ("wall", "monotonic", "boot"):
                exhibit._take(Sample("state/position", {"stamp": {name: odd}}, encoding_of(Position)))
        shown.clear()
        exhibit._take(sample_of("state/position", samples.position()))
        assert {"/state/position", "/fix"} <= set(shown)
    finally:
        await exhibit.close()


@virtually
async def test_mavlink_goes_on_beating(gateway, ears):
    unfit = ATTITUDE.model_copy(update={"roll": 1e308})  # a float of 32 bits has no room for it
    for value in (unfit, *(value for _, value in strange(COUNT, seed=3))):
        with gateway.faults.contained("a value"):
            gateway.value_arrived(value)
        ears.heard.clear()
        gateway._beat_at = float("-inf")
        gateway.tick()
        assert ears.named("HEARTBEAT"), value
    assert gateway.faults.count > 0
    ears.heard.clear()
    await beat(ears, 1.0)
    gateway.value_arrived(ATTITUDE)
    assert ears.named("ATTITUDE")


def test_names_of_cameras_that_strangers_make_up_cost_no_more_than_16():
    graph, reading = Node(), Reading()
    publishing = Publishing(graph, TOPICS, ConversionScene(BagTypes()), Newest(), Pace({}))
    for number in range(200):
        key, value = f"vision/c{number}/tags", samples.tags()
        publishing.take(sample_of(key, value))
        reading.take(key, value, 1000.0)
    assert len([name for name in graph.publishers if name.endswith("/tag_markers")]) == MOST_CAMERAS
    assert len(reading.at(1000.0).cameras()) == MOST_CAMERAS
    reading.take("state/position", samples.position(), 1000.0)
    assert reading.at(1000.0).fact("place").number is not None


async def test_names_of_keys_that_strangers_make_up_are_forgotten():
    exhibit = Exhibit(Context(), Names("mk1"), lambda now: None)
    try:
        for number in exhibit.lines:
            exhibit.subscribed(number, 1)
        for number in range(2000):
            exhibit._take(sample_of(f"event/{number}", samples.position()))
        kept = [exhibit._newest, *(line.given for line in exhibit.lines.values())]
        assert max(map(len, kept)) <= 512
        assert "event/1999" in exhibit._newest
    finally:
        await exhibit.close()


ODD = (
    *(0.0, -0.0, 1e308, -1e308, 1e-320, 1e18, -1, 2**31, 2**63, 2**64, -(2**63), None, True),
    *("", "x" * 3000, "\n\x1b[31mü{}", b"", b"\xff\xd8\xff", [], [0.0] * 4, {}),
)
"""What takes the place of a part of a value."""


def known():
    """A value of each key."""
    return dict(samples.hovering(1.0)) | dict(samples.EVERY) | KNOWN


def strange(count, seed=1):
    """Odd values of any key, each with its key.

    Args:
        count: how many.
        seed: of the draws.
    """
    draw, values = random.Random(seed), sorted(known().items())
    while count:
        key, value = draw.choice(values)
        fields = value.model_dump()
        for _ in range(draw.choice((1, 1, 2, 3))):
            fields = _with(fields, draw)
        with suppress(ValidationError):
            yield key, type(value).model_validate(fields)
            count -= 1


def _with(part, draw):
    """A value with one part of it replaced."""
    if isinstance(part, dict) and part:
        name = draw.choice(sorted(part, key=str))
        return part | {name: _with(part[name], draw)}
    if isinstance(part, list | tuple) and part and draw.random() < 0.8:
        place = draw.randrange(len(part))
        return [*part[:place], _with(part[place], draw), *part[place + 1 :]]
    return draw.choice(ODD)

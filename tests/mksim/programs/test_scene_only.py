"""`mkdaemon sim --scene-only`: another program flies, our camera sees; over a real bus, and what is refused."""

from __future__ import annotations

import asyncio
import json
import os
import re
import sys
from contextlib import asynccontextmanager

import msgpack
import numpy as np
import pytest
import zenoh

from lab.places import ROOT
from lab.rigs.waiting import wait_until
from mkdaemon.bus.session import close_session, session_config
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.camera.sources import source_of
from mkdaemon.vision.still import StillEye
from mkdaemon.vision.tags.tagmap import TagMap
from mksim.config import SceneConfig, SimConfig
from mksim.programs.scene_only import PoseStream, film_poses
from mksim.scene.camera import SceneCamera
from tests.bus.support import free_endpoint

CLOCK = Clock()
PLACE = {"t": 1.0, "position_enu": (0.0, 0.0, 2.0), "enu_from_flu": (1.0, 0.0, 0.0, 0.0)}
POSE = PLACE | {"stamp": "NOW"}
SCENE = SceneConfig(latency_ms=20.0, latency_jitter_ms=0.0)


def example():
    """The publisher of the page."""
    page = (ROOT / "docs" / "simulator.md").read_text(encoding="utf-8").split("## Another simulator")[1]
    return re.search(r"```python\n(.*?)```", page, re.DOTALL)[1]


@asynccontextmanager
async def publisher_of_the_page(endpoint):
    environment = os.environ | {"MK_CONNECT": endpoint}
    process = await asyncio.create_subprocess_exec(sys.executable, "-c", example(), env=environment)
    try:
        yield
    finally:
        process.kill()
        await process.wait()


async def test_another_program_flies_and_our_camera_sees_the_target_from_there():
    endpoint = free_endpoint()
    session = zenoh.open(session_config("peer", listen=[endpoint]))
    cfg = CameraSection(source="zenoh:mk/mk1/sim/camera/down")
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg, lambda: session), slot)
    config = SimConfig(scene=SCENE, connect=(endpoint,))
    stream.start()
    try:
        async with (
            film_poses(config, "mk1", "mk/mk1/sim/pose") as poses,
            publisher_of_the_page(endpoint),
        ):
            await wait_until(lambda: stream.status().images >= 3, 60.0)
    finally:
        stream.stop()
        await close_session(session)
    image = slot.take(0.0)
    assert poses.taken >= 3
    assert poses.refused == 0
    assert image.stamped_by == "header"
    assert image.received_at - image.captured_at >= 0.0199
    camera = SceneCamera(SCENE, 1)
    [pose] = StillEye(tagmap=TagMap(camera.targets)).look(image.pixels, camera.camera.intrinsics).poses
    assert np.linalg.norm(pose.pose.position) == pytest.approx(np.hypot(2.0, 0.2), abs=0.05)


class Feed(list):
    """What is shown, with its time."""

    def show(self, state, at):
        self.append((state, at))


@pytest.mark.parametrize(
    ("encoding", "pack"), [("application/json", lambda pose: json.dumps(pose).encode()), ("", msgpack.packb)]
)
def test_json_and_msgpack_are_read_and_a_stamp_of_this_machine_is_when_it_was(encoding, pack):
    feed = Feed()
    stream = PoseStream(feed, CLOCK)
    then = CLOCK.stamp(CLOCK.now() - 0.1)
    stream.take(encoding, pack(PLACE | {"stamp": then.model_dump(), "wind_enu": [1, 2, 3]}))
    now = CLOCK.stamp().model_dump()
    turning = {"enu_from_flu": (0.0, 0.0, 0.0, 2.0), "rates": (0.0, 0.0, 1.0), "stamp": now}
    stream.take(encoding, pack(PLACE | turning))
    (state, at), (turned, arrived) = feed
    assert at == then.monotonic
    assert state.position_enu == pytest.approx([0.0, 0.0, 2.0])
    assert turned.enu_from_flu[0] == pytest.approx([-1.0, 0.0, 0.0])
    assert arrived >= at + 0.1
    assert stream.taken == 2


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (json.dumps({"t": 1.0, "stamp": POSE["stamp"]}).encode(), "position_enu"),
        (b"[" * 3000, ""),
        (b"not json", ""),
        (b" " * 5000, "5000 bytes"),
        (json.dumps(POSE | {"enu_from_flu": (0, 0, 0, 0)}).encode(), "length zero"),
        (json.dumps(POSE | {"t": "soon"}).encode(), "t: "),
        (json.dumps(POSE | {"stamp": {"monotonic": 0.0, "wall": 1.0}}).encode(), "s after its stamp: synchronise"),
        (json.dumps(PLACE).encode(), "it has no stamp"),
        (json.dumps(PLACE | {"stamp": None}).encode(), "it has no stamp"),
    ],
)
def test_what_is_no_pose_is_counted_and_named_once_a_second(raw, words, capsys):
    feed = Feed()
    stream = PoseStream(feed, CLOCK)
    raw = raw.replace(b'"NOW"', json.dumps(CLOCK.stamp().model_dump()).encode())
    stream.take("application/json", raw)
    stream.take("application/json", raw)
    assert (stream.taken, stream.refused, feed) == (0, 2, [])
    told = capsys.readouterr().out
    assert told.count("pose refused") == 1
    assert words in told

"""What `mkctl camera` shows and advises, on a bus with a rendered image."""

from __future__ import annotations

import json
from contextlib import asynccontextmanager

import cv2
import numpy as np
import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.client import connect
from mkdaemon.client.cameralook import advise, find_camera
from mkdaemon.errors import MkError
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.vision import Exposure, EyeState, Tags, TagSighting, VisionStats
from mkdaemon.vision.camera.imagecodec import encode_jpeg
from tests.client.fake import CLOCK, VEHICLE, fake_daemon, in_background
from tests.values import made
from tests.vision.views import View, place, shipped

FIGURES = {"fps": 29.7, "processed": 900, "dropped": 9, "lost": 1, "damaged": 2, "posed": 0.93}
TIMES = {"detect_p50_ms": 9.0, "detect_p99_ms": 21.0, "latency_p50_ms": 41.0, "latency_p99_ms": 63.0}
LIGHT = Exposure(exposure_ms=4.0, gain=2.0, black=20.0, white=160.0, noise=2.0)


def stats(**more):
    """Of a camera that works."""
    seen = {"camera": "down", "state": EyeState.OK, "source": "/dev/video0", "width": 640, "height": 480}
    return made(VisionStats, CLOCK.stamp(), **seen | FIGURES | TIMES | {"exposure": LIGHT} | more)


@pytest.mark.parametrize(
    ("more", "soft", "words"),
    [
        ({"state": EyeState.UNCALIBRATED, "reason": "no camera file"}, None, "uncalibrated: no camera file"),
        ({"alarms": {"blurred": "the images are blurred"}}, None, "the images are blurred"),
        ({"settings_refused": ("exposure",)}, None, "the driver refused exposure"),
        ({"fps": 4.0}, None, "only 4 images a second"),
        ({"latency_p50_ms": 320.0}, None, "images are 320 ms old"),
        ({"dropped": 900, "detect_p50_ms": 80.0}, None, "the detector is too slow (80 ms an image)"),
        ({"exposure": LIGHT.model_copy(update={"exposure_ms": 30.0})}, None, "30.0 ms of exposure smear"),
        ({"exposure": LIGHT.model_copy(update={"black": 90.0, "white": 120.0})}, None, "hardly differ"),
        ({}, 0.4, "edges are soft (0.40 of a cell)"),
    ],
)
def test_what_is_wrong_is_said_with_what_to_change(more, soft, words):
    (advice,) = advise(stats(**more), soft)
    assert words in advice


@asynccontextmanager
async def cameras_of(*names, image=True):
    """A daemon whose cameras have published once, where they are, and what they saw."""
    view = View(shipped("nested"), place(0.8, 0.2))
    async with fake_daemon() as daemon:
        for name in names:
            publish(daemon.bus, name, view, image=image)
        yield ["--vehicle", VEHICLE, "--connect", daemon.endpoint], view


def publish(bus, name, view, *, image):
    bus.publish(f"vision/{name}/stats", stats(camera=name))
    shared = {"stamp": CLOCK.stamp(), "camera": name, "sequence": 1}
    seen = {tag.tag_id: view.corners["tag36h11", tag.tag_id].tolist() for tag in shipped("nested").tags}
    tags = [made(TagSighting, family="tag36h11", id=number, corners=corners) for number, corners in seen.items()]
    bus.publish(f"vision/{name}/tags", made(Tags, **shared, tags=tuple(tags)))
    if image:
        pixels, width, height = encode_jpeg(view.pixels, 90, 320)
        coded = {"width": width, "height": height, "coding": "jpeg", "pixels": pixels}
        bus.publish(f"vision/{name}/image", made(CameraFrame, **shared, **coded))


def test_the_screen_has_the_figures_the_tags_and_the_picture(tmp_path, capsys):
    with in_background(cameras_of("down")) as (at, view):
        assert run(app, ["camera", *at]) == EXIT_OK
        out = capsys.readouterr().out
        outer = view.corners["tag36h11", 48]
        side = np.linalg.norm(outer - np.roll(outer, 1, axis=0), axis=1).mean()
        for words in (
            "camera down: ok, 640x480, /dev/video0",
            "29.7 images a second; 9 dropped, 1 lost, 2 damaged",
            "41 ms, 99 % 63 ms; detector 9 ms",
            "4.0 ms, gain 2.0, black 20 white 160; blur: edges 0.",
            f"48 ({side:.0f} px)",
            "93 % of the images gave a pose",
            "nothing to change",
        ):
            assert words in out, words
        assert "oooo" in out  # outlines; no terminal, so no colours
        picture = tmp_path / "found.png"
        assert run(app, ["camera", "down", *at, "--picture", str(picture)]) == EXIT_OK
        drawn = cv2.imread(str(picture))
        assert drawn.shape == (240, 320, 3)
        corner = ((outer[0] + 0.5) / 2 - 0.5).round().astype(int)
        near = drawn[corner[1] - 2 : corner[1] + 3, corner[0] - 2 : corner[0] + 3].astype(int)
        assert np.ptp(near, axis=2).max() > 100  # in colour, where the tag's corner is
        assert run(app, ["camera", *at, "--picture", str(picture)]) == EXIT_CONFIG
        capsys.readouterr()
        assert run(app, ["camera", *at, "--json"]) == EXIT_OK
        told = json.loads(capsys.readouterr().out)
        assert (told["camera"], told["advice"], told["tags"][0]["id"]) == ("down", [], 48)
        assert 0.0 < told["softness"] < 0.1


def test_a_camera_that_cannot_be_shown_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("mkdaemon.cli.mkctl.camera.IMAGE_TIME", 0.1)
    with in_background(cameras_of("down", "front", image=False)) as (at, _):
        assert run(app, ["camera", *at]) == EXIT_FAILURE
        assert "which camera? There is down, front" in capsys.readouterr().err
        assert run(app, ["camera", "up", *at]) == EXIT_FAILURE
        assert "no camera 'up'; there is down, front" in capsys.readouterr().err
        assert run(app, ["camera", "front", *at]) == EXIT_OK
        assert "no image on the bus: set jpeg_hz" in capsys.readouterr().out
        assert run(app, ["camera", "front", *at, "--picture", str(tmp_path / "x.png")]) == EXIT_FAILURE
        assert "no image on the bus" in capsys.readouterr().err


async def test_a_source_of_poses_is_no_camera():
    async with fake_daemon() as daemon, connect(VEHICLE, daemon.endpoint) as uav:
        daemon.bus.publish("vision/mocap/stats", stats(camera="mocap", trusted_for=("flight",)))
        with pytest.raises(MkError, match="has no camera"):
            await find_camera(uav)
        daemon.bus.publish("vision/down/stats", stats(camera="down"))
        assert await find_camera(uav) == "down"

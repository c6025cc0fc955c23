"""Cameras of a running daemon: what they see is on the bus, and a defect ends no flight."""

from __future__ import annotations

import asyncio

import cv2
import numpy as np
import structlog

from mkdaemon.bus.gateway import Bus
from mkdaemon.client import connect
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.root import Config
from mkdaemon.control.core import FlightCore
from mkdaemon.daemon.eyes import Eyes, open_eyes
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.state import Altitude, Attitude
from tests.bus.support import PATIENCE, bus_config, free_endpoint
from tests.places import CONFIGS

CORE = FlightCore(ControlConfig(), first_epoch=1)
TARGET = CONFIGS / "targets" / "nested.toml"
LEVEL = Attitude(
    stamp=Stamp(monotonic=1.0, wall=2.0),
    source="nc/attitude",
    quaternion=(1.0, 0.0, 0.0, 0.0),
    roll=0.0,
    pitch=0.0,
    yaw=0.0,
)  # fmt: skip


async def test_a_camera_reports_on_the_bus(tmp_path):
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((120, 160), 128, np.uint8))
    endpoint = free_endpoint()
    camera = CameraSection(name="down", source=f"folder:{tmp_path}", loop=True, fps=20.0, targets=(TARGET,))
    cfg = Config(bus=bus_config(endpoint), cameras=(camera,))
    async with Bus.open(cfg.bus, "eyes") as bus, connect("eyes", endpoint) as client:
        eyes = open_eyes(cfg, bus, Clock(), CORE.feed)
        async with client.watch("vision/**") as samples, eyes.open():
            eyes.attitude_received(LEVEL)
            async with asyncio.timeout(PATIENCE):
                async for sample in samples:
                    if sample.suffix == "vision/down/stats" and sample.fields["width"] > 0:
                        break
    assert sample.fields["camera"] == "down"
    assert (sample.fields["width"], sample.fields["height"]) == (160, 120)
    assert [stats.camera for stats in CORE.vehicle.eyes] == ["down"]


HEIGHT = Altitude(stamp=Stamp(monotonic=1.0, wall=2.0), source="nc/osd", above_start=3.5)


def test_the_barometers_height_reaches_the_cameras_where_the_boards_know_it():
    heard = []
    worker = Worker()
    worker.barometer_arrived = lambda time, height: heard.append((time, height))
    eyes = Eyes(worker)
    eyes.altitude_received(HEIGHT)
    Eyes(None).altitude_received(HEIGHT)
    assert heard == [(1.0, 3.5)]


class Worker:
    """Cameras whose supervision fails."""

    def start(self):
        self.is_running = True

    def stop(self, timeout):
        self.is_running = False

    async def supervise(self):
        raise RuntimeError("wires crossed")


async def test_a_defect_in_looking_after_the_cameras_is_logged_and_ends_no_flight():
    worker = Worker()
    with structlog.testing.capture_logs() as logs:
        async with Eyes(worker).open():
            await asyncio.sleep(0.01)
            assert worker.is_running
    assert not worker.is_running
    [entry] = logs
    assert (entry["log_level"], str(entry["exc_info"])) == ("error", "wires crossed")

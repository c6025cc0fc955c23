"""The simulated camera on a real bus: frames of the flight arrive where a daemon's camera looks for them."""

from __future__ import annotations

import asyncio
from pathlib import Path

import cv2
import pytest
import zenoh

from mkdaemon.bus.session import close_session, session_config
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.camera.sources import source_of
from mksim.config import PilotPlan, SceneConfig, SimConfig
from mksim.programs.sim_camera import CameraPublisher, open_camera, run_camera
from mksim.simulation import Simulation


def is_film(clip: Path) -> bool:
    """Whether a video has a picture."""
    video = cv2.VideoCapture(str(clip))
    has_picture, _ = video.read()
    video.release()
    return has_picture


@pytest.mark.parametrize("is_signed", [False, True])
async def test_frames_of_the_simulation_reach_a_camera_on_the_bus(tmp_path: Path, is_signed: bool) -> None:
    secret_file = tmp_path / "image.key" if is_signed else None
    if secret_file is not None:
        secret_file.write_text("0123456789abcdef", encoding="utf-8")
    scene = SceneConfig(enabled=True, fps=20, latency_ms=10.0, latency_jitter_ms=0.0, video=tmp_path / "flight.avi")
    config = SimConfig(scene=scene, pilot_plan=PilotPlan.NOTHING)
    session = zenoh.open(session_config("peer"))
    cfg = CameraSection(source="zenoh:mk/film/sim/camera/down", secret_file=secret_file)
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg, lambda: session), slot)
    simulation = Simulation(config)
    stream.start()
    try:
        async with asyncio.timeout(120.0):
            publisher = CameraPublisher("film", "down", secret_file)
            publisher.send(CameraFrame(stamp=Clock().stamp(), width=1, height=1, coding="gray8", pixels=b"0"))
            assert not publisher.is_open, "without a bus a picture goes nowhere"
            async with run_camera(open_camera(config), simulation, config, publisher):
                before = simulation.now
                with publisher.open(session):
                    while stream.status().images < 3:
                        simulation.advance(simulation.now + 0.025)
                        await asyncio.sleep(0.01)
                assert simulation.now > before
                assert not publisher.is_open
    finally:
        stream.stop()
        await close_session(session)
    image = slot.take(0.0)
    assert image.stamped_by == "header"
    assert image.pixels.shape == (480, 640)
    assert image.received_at - image.captured_at >= 0.0099
    assert is_film(tmp_path / "flight.avi")


async def test_a_video_that_cannot_be_written_stops_the_simulator_at_once(tmp_path: Path) -> None:
    config = SimConfig(scene=SceneConfig(enabled=True, video=tmp_path / "no" / "flight.avi"))
    with pytest.raises(ConfigError, match=r"sim\.scene\.video"):
        async with run_camera(open_camera(config), Simulation(config), config, CameraPublisher("film", "down")):
            pytest.fail("filmed")

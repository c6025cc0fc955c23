"""The simulated camera on the bus: a daemon takes it as `zenoh:mk/<vehicle>/sim/camera/<name>`."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import zenoh

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.names import key
from mkdaemon.config.camera import read_image_secret
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.signature import private_key, sign
from mksim.config import SimConfig
from mksim.runtime import running
from mksim.simulation import Simulation

if TYPE_CHECKING:
    from mksim.physics.world import World
    from mksim.scene.camera import SceneCamera
    from mksim.scene.outputs import FrameWriter

CAMERA_TICK_TIME = 0.002
"""Period of the clock check [s]: exposures are this punctual, their stamps exact."""


def open_camera(config: SimConfig) -> SceneCamera | None:
    """Prepare the configured camera; a simulator without one never loads OpenCV.

    Raises:
        ConfigError: a camera or target file is wrong.
    """
    if not config.scene.enabled:
        return None
    from mksim.scene.camera import SceneCamera

    return SceneCamera(config.scene, config.seed, walls=config.flight.walls)


def open_world(config: SimConfig) -> World | None:
    """The world whose ground is the scene's moving platform; None for the configured world on flat ground."""
    if not config.scene.enabled:
        return None
    from mksim.scene.camera import landing_world

    return landing_world(config)


class CameraPublisher:
    """Publishes pictures while it has a session; without one they are dropped."""

    def __init__(self, vehicle: str, camera: str, secret_file: Path | None = None) -> None:
        """Prepare.

        Args:
            vehicle: its name.
            camera: its name.
            secret_file: holds the secret that signs its images; None signs none.

        Raises:
            ConfigError: the secret cannot be read.
        """
        self._plain = key(vehicle, f"sim/camera/{camera}")
        self._secret = None if secret_file is None else read_image_secret(secret_file)
        self._key = self._plain if self._secret is None else private_key(self._secret, self._plain)
        self._publisher: zenoh.Publisher | None = None
        self._encoding = encoding_of(CameraFrame)

    @property
    def is_open(self) -> bool:
        """Whether a session is there."""
        return self._publisher is not None

    @contextlib.contextmanager
    def open(self, session: zenoh.Session) -> Iterator[None]:
        """Send through `session` while the context lasts."""
        self._publisher = session.declare_publisher(self._key, congestion_control=zenoh.CongestionControl.DROP)
        try:
            yield
        finally:
            self._publisher = None

    def send(self, frame: CameraFrame) -> None:
        """Put one picture; from any thread."""
        publisher = self._publisher
        if publisher is not None:
            payload = encode(frame)
            proof = None if self._secret is None else sign(self._secret, self._plain, payload)
            with contextlib.suppress(zenoh.ZError):  # the session ends at the same moment
                publisher.put(payload, encoding=self._encoding, attachment=proof)


@contextlib.asynccontextmanager
async def run_camera(
    camera: SceneCamera | None, simulation: Simulation, config: SimConfig, publisher: CameraPublisher
) -> AsyncIterator[None]:
    """Take pictures for as long as the context lasts: for the bus while it is there, for video and loop device always.

    Raises:
        ConfigError: a video or loop device cannot be written.
    """
    if camera is None:
        yield
        return
    from mksim.scene.feed import SceneFeed

    writers = _writers(camera)
    feed = SceneFeed(camera, publisher.send, seed=config.seed, writers=writers)
    feed.start()

    async def expose() -> None:
        while True:
            if writers or publisher.is_open:
                feed.tick(simulation.now, simulation.world.truth, simulation.world.faults)
            await asyncio.sleep(CAMERA_TICK_TIME)

    try:
        async with running(expose(), "simulated camera"):
            yield
    finally:
        await asyncio.shield(asyncio.to_thread(feed.stop))


def _writers(camera: SceneCamera) -> tuple[FrameWriter, ...]:
    from mksim.scene.outputs import LoopWriter, VideoWriter

    cfg, k = camera.cfg, camera.camera.intrinsics
    writers: list[FrameWriter] = []
    if cfg.video is not None:
        writers.append(VideoWriter(cfg.video, k.width, k.height, cfg.fps))
    if cfg.v4l2_loop is not None:
        writers.append(LoopWriter(cfg.v4l2_loop, k.width, k.height))
    return tuple(writers)

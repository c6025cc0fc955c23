"""`mkdaemon sim --scene-only`: the simulated camera alone, moved by published poses."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Final

import numpy as np
import structlog
import zenoh
from pydantic import ValidationError

from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import decode_map, first_mistake
from mkdaemon.clock import Clock
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.telemetry.sim import ScenePose
from mksim.config import SimConfig
from mksim.programs.sim_camera import CameraPublisher
from mksim.programs.simsession import check_endpoints, stay_connected
from mksim.runtime import running

if TYPE_CHECKING:
    from mksim.scene.feed import SceneFeed

_log = structlog.get_logger(__name__)
JSON: Final = "application/json"
LONGEST: Final = 4096
"""Longest pose that is read [bytes]."""
MOST_APART: Final = 0.5
"""A stamp farther from our clock says nothing about when the pose was [s]."""
LATE: Final = 0.05
"""Delay of a pose after its stamp that is reported [s]: most of an image's latency."""
LATENESS_PERIOD: Final = 5.0
"""Between two lines of the log about that [s]."""
COMPLAINT_PERIOD: Final = 1.0
"""Between two lines of the log about poses that are refused [s]."""


class PoseStream:
    """Takes poses from the bus to the camera.

    Attributes:
        taken: poses that could be read.
        refused: poses that could not.
        latest: largest delay of a pose after its stamp since the last report [s].
    """

    def __init__(self, feed: SceneFeed, clock: Clock) -> None:
        self.taken = self.refused = 0
        self._feed, self._clock = feed, clock
        self._complained_at = self._reported_at = float("-inf")
        self.latest = 0.0

    def take(self, encoding: str, raw: bytes) -> None:
        """Take one pose, at once; one that cannot be read is counted and named in the log.

        Args:
            encoding: `application/json`; anything else is a msgpack map.
            raw: as it came.
        """
        from mksim.scene.camera import BodyState

        now = self._clock.now()
        try:
            pose = _read(encoding, raw)
            at = self._clock.monotonic_of(pose.stamp)
            if abs(at - now) > MOST_APART:
                words = "synchronise the clocks, or send it sooner"
                raise ValueError(f"it came {now - at:+.1f} s after its stamp: {words}")
            state = BodyState(
                pose.t,
                np.array(pose.position_enu),
                np.array(pose.velocity_enu),
                rotation_from_quaternion(pose.enu_from_flu),
                np.array(pose.rates),
            )
        except (ValueError, RecursionError, CommandRejectedError) as error:
            self._refuse(error)
            return
        if not self.taken:
            _log.info("first pose", t=pose.t)
        self.taken += 1
        self._feed.show(state, at)
        self._report_lateness(now - at)

    def _report_lateness(self, late: float) -> None:
        """Tell how late poses come, where that is much: images are later by as much."""
        self.latest = max(self.latest, late)
        if time.monotonic() - self._reported_at >= LATENESS_PERIOD:
            if self.latest > LATE:
                _log.warning("poses come late", latest_ms=round(1000.0 * self.latest), fix="the machine is too busy")
            self._reported_at, self.latest = time.monotonic(), 0.0

    def _refuse(self, error: Exception) -> None:
        self.refused += 1
        if time.monotonic() - self._complained_at >= COMPLAINT_PERIOD:
            self._complained_at = time.monotonic()
            words = first_mistake(error) if isinstance(error, ValidationError) else str(error)
            _log.warning("pose refused", why=words, refused=self.refused)


def _read(encoding: str, raw: bytes) -> ScenePose:
    """Read a pose.

    Raises:
        ValueError: it is none, or too long.
        CommandRejectedError: it is not a msgpack map.
    """
    if len(raw) > LONGEST:
        raise ValueError(f"{len(raw)} bytes, more than {LONGEST}")
    fields = json.loads(raw) if JSON in encoding else decode_map(raw)
    if isinstance(fields, dict) and fields.get("stamp") is None:
        raise ValueError("it has no stamp: say when the aircraft was there, {monotonic, boot, wall}; docs/simulator.md")
    return ScenePose.model_validate(fields)


@contextlib.asynccontextmanager
async def film_poses(config: SimConfig, vehicle: str, expression: str) -> AsyncIterator[PoseStream]:
    """Render what a camera at the poses under a key sees, for as long as the context lasts.

    Args:
        config: where to connect to, camera, target and light.
        vehicle: under whose name the images are published.
        expression: the key, or a pattern of keys.

    Raises:
        ConfigError: the key, an endpoint, or a camera or target file is wrong.
    """
    from mksim.scene.camera import SceneCamera
    from mksim.scene.feed import SceneFeed

    check_endpoints(config.connect)
    try:
        where = zenoh.KeyExpr(expression)
    except zenoh.ZError as error:
        msg = f"--truth {expression!r}: no key; give one like mk/{vehicle}/sim/pose"
        raise ConfigError(msg) from error
    publisher = CameraPublisher(vehicle, config.scene.name, config.scene.secret_file)
    camera = SceneCamera(config.scene, config.seed, walls=config.flight.walls)
    feed = SceneFeed(camera, publisher.send, seed=config.seed)
    stream = PoseStream(feed, Clock())

    def arrived(sample: zenoh.Sample) -> None:
        stream.take(str(sample.encoding), sample.payload.to_bytes())

    async def serve(session: zenoh.Session) -> None:
        handler = direct(arrived)
        with publisher.open(session), contextlib.closing(_Subscription(session.declare_subscriber(where, handler))):
            await asyncio.Event().wait()

    feed.start()
    try:
        async with running(stay_connected(config.connect, serve), "scene on the bus"):
            yield stream
    finally:
        await asyncio.shield(asyncio.to_thread(feed.stop))


class _Subscription:
    """A subscription that is closed on leaving."""

    def __init__(self, subscriber: zenoh.Subscriber[None]) -> None:
        self._subscriber = subscriber

    def close(self) -> None:
        """End it; the session may be closed already."""
        with contextlib.suppress(zenoh.ZError):
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]

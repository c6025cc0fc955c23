"""Real time for the simulated camera: exposures on time, rendering in a thread, frames out after their latency."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import structlog

from mkdaemon.clock import Clock
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.vision.camera.image import NewestSlot
from mksim.faults import RunningFaults
from mksim.physics.truth import Truth
from mksim.scene.camera import BodyState, SceneCamera
from mksim.scene.outputs import FrameWriter

_log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class _Exposure:
    state: BodyState
    light: float
    covered: float
    sequence: int
    monotonic: float


class SceneFeed:
    """Takes pictures of a running simulation.

    The simulation calls `tick` as often as it likes; it only copies the state when an exposure is due. A picture the
    renderer could not keep up with is lost and its number is missing, as with a real camera.

    Args:
        camera: renders.
        send: puts a frame on the bus; called from the render thread.
        seed: of latency jitter.
        writers: further places for every picture.
    """

    def __init__(
        self,
        camera: SceneCamera,
        send: Callable[[CameraFrame], None],
        *,
        seed: int,
        writers: tuple[FrameWriter, ...] = (),
    ) -> None:
        self._camera = camera
        self._send = send
        self._writers = writers
        self._clock = Clock()
        self._rng = np.random.default_rng([seed, 0xCA3E])
        self._due = -np.inf
        self._sequence = 0
        self._slot: NewestSlot[_Exposure] = NewestSlot()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="scene", daemon=True)
        self.render_ms = 0.0
        self.sent = 0

    @property
    def dropped(self) -> int:
        """Pictures the renderer could not keep up with."""
        return self._slot.dropped.total()

    def start(self) -> None:
        """Start rendering."""
        self._thread.start()

    def stop(self) -> None:
        """End; idempotent."""
        self._stop.set()
        self._slot.close()
        if self._thread.ident is not None:
            self._thread.join(5.0)
        for writer in self._writers:
            writer.close()

    def tick(self, now: float, truth: Truth, faults: RunningFaults) -> None:
        """Expose when it is time.

        Args:
            now: simulated time [s].
            truth: of the aircraft.
            faults: `camera_off`, `light_off` and `tag_covered` are read.
        """
        if not self._is_due(now) or faults.is_active("camera_off"):
            return
        state = BodyState(now, truth.position_enu, truth.velocity_enu, truth.enu_from_flu, truth.rates)
        light = faults.number("light_off", "share") if faults.is_active("light_off") else 1.0
        covered = faults.number("tag_covered", "share") if faults.is_active("tag_covered") else 0.0
        self._expose(state, time.monotonic(), light=light, covered=covered)

    def show(self, state: BodyState, exposed_at: float) -> None:
        """Expose a pose that another simulator gives, when it is time.

        Args:
            state: of the aircraft; its time may restart.
            exposed_at: when it was so [s; monotonic].
        """
        if self._is_due(state.time):
            self._expose(state, exposed_at)

    def _is_due(self, now: float) -> bool:
        period = 1.0 / self._camera.cfg.fps
        if self._due - now > 2.0 * period:
            self._due = now  # another flight has begun
        if now < self._due:
            return False
        self._due = now + period if now - self._due > period else self._due + period
        return True

    def _expose(self, state: BodyState, at: float, *, light: float = 1.0, covered: float = 0.0) -> None:
        self._sequence += 1
        self._slot.put(_Exposure(state, light, covered, self._sequence, at))

    def _run(self) -> None:
        waiting: deque[tuple[float, CameraFrame]] = deque()
        while not self._stop.is_set():
            patience = 0.2 if not waiting else min(max(waiting[0][0] - time.monotonic(), 0.0), 0.2)
            exposure = self._slot.take(patience)
            if exposure is not None:
                frame = self._render(exposure)
                cfg = self._camera.cfg
                latency = cfg.latency_ms + cfg.latency_jitter_ms * abs(float(self._rng.standard_normal()))
                at = exposure.monotonic + latency / 1000.0
                waiting.append((max(at, waiting[-1][0]) if waiting else at, frame))
            while waiting and waiting[0][0] <= time.monotonic():
                self._send(waiting.popleft()[1])
                self.sent += 1

    def _render(self, exposure: _Exposure) -> CameraFrame:
        """One image for the bus."""
        started = time.perf_counter()
        pixels = self._camera.expose(exposure.state, light=exposure.light, covered=exposure.covered)
        spent = 1000.0 * (time.perf_counter() - started)
        self.render_ms = spent if not self.render_ms else self.render_ms + 0.05 * (spent - self.render_ms)
        for writer in self._writers:
            try:
                writer.write(pixels)
            except OSError as error:
                # a loop device that vanished must not stop the camera
                _log.warning("picture not written", to=type(writer).__name__, error=error.strerror or str(error))
                self._writers = tuple(other for other in self._writers if other is not writer)
                writer.close()
        cfg = self._camera.cfg
        exposed = exposure.monotonic + cfg.stamp_error_ms / 1000.0
        height, width = pixels.shape
        return CameraFrame(
            camera=cfg.name,
            sequence=exposure.sequence,
            width=width,
            height=height,
            coding="gray8",
            stamp=self._clock.stamp(exposed),
            pixels=pixels.tobytes(),
        )

"""The camera of a daemon in virtual time that records itself: rendered images through the product's own eyes."""

from __future__ import annotations

import asyncio
import random
from collections import deque
from collections.abc import Coroutine, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeVar

from lab.rigs.blackbox import RecordedDaemon
from lab.rigs.waiting import running, wait_until
from mkdaemon.config.root import Config
from mkdaemon.control.events import Feed
from mkdaemon.daemon.blackbox import ImageRecorder
from mkdaemon.daemon.eyes import Eyes, PoseSink
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.virtualtime import VirtualLoop, end_loop
from mkdaemon.vision.camera.camera import StreamStatus
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mksim.config import LightConfig, PilotPlan, SceneConfig, SimConfig
from mksim.scene.camera import BodyState, Grey, SceneCamera
from mksim.simulation import Simulation

CAMERA: Final = Path("tests/data/recordings/camera.toml")
TARGET: Final = Path("configs/targets/nested.toml")
"""Relative, so that a recording says nothing about this machine: they are found from the root of the source."""
TICK: Final = 1.6e-2
"""How often bytes are carried, as by a radio [s]."""
RATE: Final = 30.0
"""Of setpoints and of stick frames [Hz]."""
IDLING: Final = 4.5
"""The aircraft has stood on the target for so long: its pilot has started the motors [s]."""
LATENCY: Final = 0.06
"""From the exposure to the host [s]."""
EYES_TIME: Final = 0.012
"""What the eyes need for an image [s]."""
STATS: Final = 1.0
"""Time between two reports of the camera [s]."""
ATTITUDES: Final = 200
"""Attitudes kept; as many as `mkdaemon.vision.worker` keeps."""


WORK: Final = 2e-6
"""Time that passes from one look at the clock to the next [s]."""
LATE: Final = 4e-4
"""Mean time by which timers fire late [s]."""
STALL: Final = 0.015
"""Longest of the rare pauses, one wake-up in three hundred [s]."""

_Result = TypeVar("_Result")


class TardyLoop(VirtualLoop):
    """An event loop in virtual time that is never on time."""

    def __init__(self, seed: int, start: float = 0.0) -> None:
        """Begin.

        Args:
            start: time of the beginning [s].
        """
        super().__init__(start=start)
        self._random = random.Random(f"{seed} tardy")
        self._passed = 0.0
        self._seen = start

    def time(self) -> float:
        """Virtual time, a little later with every look [s], in the nanoseconds of a clock."""
        reached = super().time()
        if reached != self._seen:
            self._seen = reached
            self._passed += self._random.expovariate(1 / LATE)
            if self._random.random() < 1 / 300:
                self._passed += self._random.uniform(0.0, STALL)
        self._passed += WORK
        return round(reached + self._passed, 9)


def run_tardily(main: Coroutine[Any, Any, _Result], seed: int, start: float = 0.0) -> _Result:
    """Run a coroutine to its end on a loop that is never on time."""
    loop = TardyLoop(seed, start)
    try:
        return loop.run_until_complete(main)
    finally:
        end_loop(loop)


class RecordedEyes(Eyes):
    """One camera; what it sees comes to the loop later, as from the thread of `VisionWorker`."""

    def __init__(self, scene: SceneCamera, feed: Feed, daemon: RecordedDaemon) -> None:
        """Set the camera up."""
        super().__init__(None)
        (camera,) = daemon.cfg.cameras
        self._name, self._scene, self._clock = camera.name, scene, daemon.clock
        self._socket = daemon.socket
        self._sink = PoseSink(feed, daemon.client, daemon.clock)
        self._record = ImageRecorder(daemon.cfg.record.images, daemon.tape.tap, daemon.clock).record
        self._pipeline = CameraPipeline(camera, daemon.cfg.vision, daemon.clock)
        self._attitudes: deque[AttitudeSample] = deque(maxlen=ATTITUDES)
        self._images = 0

    def attitude_received(self, attitude: Attitude) -> None:
        """Tell the eyes how the vehicle lies."""
        at = attitude.stamp.monotonic
        self._attitudes.append(AttitudeSample(at, attitude.roll, attitude.pitch, attitude.yaw))

    async def run(self, dark: float) -> None:
        """Expose for ever, from a time on [s]."""
        await asyncio.sleep(dark)
        loop = asyncio.get_running_loop()
        due = report = self._clock.now()
        while True:
            truth, at = self._socket.aircraft.world.truth, self._clock.now()
            state = BodyState(at, truth.position_enu, truth.velocity_enu, truth.enu_from_flu, truth.rates)
            loop.call_later(LATENCY, self._look, self._scene.expose(state), at)
            if at >= report:
                report += STATS
                self._report()
            due += 1.0 / self._scene.cfg.fps
            await asyncio.sleep(max(due - self._clock.now(), 0.0))

    def _look(self, pixels: Grey, exposed: float) -> None:
        self._images += 1
        image = CameraImage(pixels, exposed, self._clock.now(), self._images, self._name, "header")
        attitude = AttitudeHistory(tuple(self._attitudes))
        self._record(image, attitude)
        values = self._pipeline.process(image, attitude)
        asyncio.get_running_loop().call_later(EYES_TIME, self._publish, values)

    def _publish(self, values: list[tuple[str, Telemetry]]) -> None:
        for suffix, value in values:
            self._sink.publish(suffix, value)

    def _report(self) -> None:
        k, stamp = self._scene.camera.intrinsics, self._clock.stamp()
        status = StreamStatus(
            state=EyeState.OK,
            images=self._images,
            fps=self._scene.cfg.fps,
            width=k.width,
            height=k.height,
        )
        stats = self._pipeline.stats(status, stamp)
        mount = self._pipeline.mount(stamp)
        tree = [] if mount is None else [("tf", mount)]
        self._publish([(f"vision/{self._name}/stats", stats), *tree])


class Part(NamedTuple):
    """A part of a flight.

    Attributes:
        seconds: for how long [s].
    """

    kind: type[Setpoint]
    seconds: float
    fields: Mapping[str, Any] = MappingProxyType({})


async def fly_over_target(parts: Sequence[Part], folder: Path, *, seed: int, fps: float, dark: float) -> RecordedDaemon:
    """Fly by itself over a target, from motors that idle on to the end of the last part, and record it.

    Args:
        dark: the camera delivers its first image so late [s].

    Raises:
        TimeoutError: the boards were not known, or the motors did not run.
    """
    scene = SceneConfig(
        enabled=True, fps=fps, camera=CAMERA, targets=(TARGET,), light=LightConfig(exposure=0.3, jpeg_quality=60)
    )
    sim = SimConfig(
        board="fc", fc="2.12a", seed=seed, calibrated=True, pilot_plan=PilotPlan.START, pilot_wait=0.5, scene=scene
    )
    camera = {"name": "down", "source": "zenoh:sim", "calibration": CAMERA, "targets": (TARGET,), "jpeg_hz": 0.0}
    cfg = Config.model_validate(
        {
            "vehicle": {"name": "t", "state_folder": folder},
            "link": {"port": "/dev/virtual", "rates": {"attitude": 50, "debug": 200}},
            "control": {"rate": RATE},
            "bus": {"listen": ()},
            "record": {"images": {"hz": 120, "coding": "png"}},
            "cameras": (camera,),
        }
    )
    camera_of_aircraft = SceneCamera(scene, seed)
    daemon = RecordedDaemon(
        cfg,
        lambda: Simulation(sim),
        seed=seed,
        tick=TICK,
        age=IDLING,
        make_eyes=lambda feed, daemon: RecordedEyes(camera_of_aircraft, feed, daemon),
    )
    client = daemon.client
    assert isinstance(daemon.wiring.eyes, RecordedEyes)
    async with running(daemon.wiring.eyes.run(dark)):
        await daemon.begin()
        await wait_until(lambda: bool(daemon.wiring.facts.motors_running(daemon.clock.now())), step=0.02)
        await client.take_lease()
        for part in parts:
            await client.stream(part.kind, part.seconds, period=1.0 / RATE, **part.fields)
        await client.give_back()
        await asyncio.sleep(0.3)
    await daemon.stop()
    return daemon

"""The flight of the demonstration: take-off, hold, a step of 1 m, the target starts to move, landing on it.

The daemon is the one that flies an aircraft, wired as on it, on other ports: a cable to simulated boards, a bus without
Zenoh, a camera that renders, and virtual time. Left out are only Zenoh, the guard and the wall clock.
"""

from __future__ import annotations

import asyncio
import random
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Protocol, TypeVar

from pydantic import BaseModel

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.control.events import Feed
from mkdaemon.daemon.eyes import Eyes, PoseSink
from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlStatus
from mkdaemon.telemetry.path import PathUploadRequest
from mkdaemon.telemetry.setpoint import (
    LandSetpoint,
    PathSetpoint,
    PositionSetpoint,
    Setpoint,
    SetpointFrame,
    TakeOffSetpoint,
)
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import EyeState, VisionPose
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.camera import StreamStatus
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mksim.config import PilotPlan, PlatformConfig, SimConfig, WindClass
from mksim.physics.world import StartState, World
from mksim.programs.flightrecord import Moment, Rehearsed
from mksim.programs.flighttape import FlightTape
from mksim.programs.virtualdaemon import VirtualDaemon, virtual_clock, virtual_config
from mksim.programs.virtualports import Aircraft, Cable, LocalBus
from mksim.scene.camera import BodyState, Grey, SceneCamera, landing_world
from mksim.scene.nested import nested_map
from mksim.scene.room import AWAY, GOAL, figure_of_eight, room_map
from mksim.simulation import Simulation

PAD_STARTS: Final = 45.0
"""The target stands until then [s]."""
PAD_SPEED: Final = 0.3
"""Of the target once it moves, east [m/s]."""
IMAGE_LATENCY: Final = 0.060
"""From the exposure to the host [s]; vision's computing time is added."""
EYES_TIME: Final = 0.020
"""Computing time of vision for an image on an ordinary computer [s], because virtual time has none."""


def simulated_aircraft(seed: int, wind: str, fps: float, loss: float | None = None) -> SimConfig:
    """An aircraft on its target: the pilot starts the motors and leaves the rest to the machine.

    Args:
        seed: of everything random.
        wind: none, indoor, light or moderate.
        fps: images a second.
        loss: share of the radio's packets that are lost, each way; None for the radio's default.

    Raises:
        ValidationError: `loss` is not between 0 and 0.5.
    """
    radio: dict[str, Any] = {"kind": "xbee"} if loss is None else {"kind": "xbee", "loss": loss}
    platform = {"kind": "ramp", "speed": PAD_SPEED, "acceleration": 0.15, "delay": PAD_STARTS}
    scene: dict[str, Any] = {"enabled": True, "fps": fps, "exposure_ms": 6.0, "platform": platform}
    return SimConfig.model_validate(
        {
            "seed": seed,
            "board": "fc",
            "pilot_plan": PilotPlan.START,
            "pilot_wait": 4.0,
            "flight": {"wind": wind},
            "radio": {"to_board": radio, "to_host": radio | {"usb_timer": 0.001}},
            "scene": scene | {"light": {"noise_sd": 2.0}},
        }
    )


CAMERA: Final = "down"
"""Name of the simulated camera."""
ATTITUDES_KEPT: Final = 200
"""Attitudes kept for late images."""
JPEG_HZ: Final = 5.0
"""Images that are shown a second."""
JITTER: Final = 0.005
"""Standard deviation of the latency [s]."""


Show = Callable[[str, BaseModel], None]
"""Publishes a value under a key."""
ShowOn = Callable[[LocalBus, Clock], AbstractContextManager[Show]]
"""Shows a flight while a context lasts: what it gives takes every value."""


class RehearsedEyes(Eyes):
    """The camera of the simulated aircraft and what looks through it.

    Attributes:
        images: processed.
        posed: of those, with a pose.
        is_watched: a viewer shows the images.
    """

    def __init__(
        self,
        scene: SceneCamera,
        world: World,
        feed: Feed,
        clock: Clock,
        seed: int,
        bus: LocalBus,
        lens: Intrinsics,
        tagmap: TagMap,
    ) -> None:
        super().__init__(None)
        self.images = self.posed = 0
        self.is_watched = False
        self._sink = PoseSink(feed, bus, clock)
        self._scene, self._world, self._clock = scene, world, clock
        self._rng = random.Random(f"{seed} latency")
        self._attitudes: deque[AttitudeSample] = deque(maxlen=ATTITUDES_KEPT)
        self._pipeline = CameraPipeline(
            CameraSection(name=CAMERA, source="simulated", jpeg_hz=JPEG_HZ, jpeg_quality=80, jpeg_width=lens.width),
            VisionSection(),
            clock,
            camera=scene.camera.model_copy(update={"intrinsics": lens}),
            tagmap=tagmap,
        )
        self._stream = StreamStatus(EyeState.OK, "", fps=scene.cfg.fps, width=lens.width, height=lens.height)

    def attitude_received(self, attitude: Attitude) -> None:
        """Give vision the attitude."""
        at = attitude.stamp.monotonic
        self._attitudes.append(AttitudeSample(at, attitude.roll, attitude.pitch, attitude.yaw))

    async def run(self) -> None:
        """Expose for ever."""
        loop = asyncio.get_running_loop()
        period, due = 1.0 / self._scene.cfg.fps, loop.time()
        while True:
            truth, at = self._world.truth, self._clock.now()
            state = BodyState(at, truth.position_enu, truth.velocity_enu, truth.enu_from_flu, truth.rates)
            pixels = self._scene.expose(state)
            latency = IMAGE_LATENCY + EYES_TIME + abs(self._rng.gauss(0.0, JITTER))
            loop.call_later(latency, self._look, pixels, at)
            due += period
            await asyncio.sleep(due - loop.time())

    def _look(self, pixels: Grey, exposed: float) -> None:
        self.images += 1
        pipeline = self._pipeline
        image = CameraImage(pixels, exposed, self._clock.now(), self.images, CAMERA, "header")
        values = pipeline.process(image, AttitudeHistory(tuple(self._attitudes)))
        self.posed += any(isinstance(value, VisionPose) for _, value in values)
        pipeline.check_files()
        values += pipeline.report(self._stream._replace(images=self.images), self._clock.stamp())
        if self.is_watched and (picture := pipeline.picture(image)) is not None:
            values.append(picture)
        for suffix, value in values:
            self._sink.publish(suffix, value)


HEIGHT: Final = 2.0
"""Flown above the target [m]."""
PERIOD: Final = 0.02
"""Of setpoints [s]."""
KEPT: Final = 0.05
"""Of moments in the record [s]."""
OLD: Final = 0.5
"""Errors and estimates older than this are not shown [s]: nothing is flown by them."""
READY: Final = 30.0
"""Longest wait for the boards to be known and the motors to run [s]."""
LONGEST: Final = 40.0
"""Longest part of the flight [s]."""
_Value = TypeVar("_Value", bound=BaseModel)
Watcher = Callable[[Moment, ControlStatus | None], None]
"""Sees every moment of the record, and the latest status."""


@dataclass(frozen=True, slots=True)
class FlightPart:
    """What is streamed for a while.

    Attributes:
        name: in the record.
        kind: of the setpoint.
        fields: of it.
        seconds: how long; None until it is done.
        until: the time at which it ends in place of that [s].
        wind: that blows from then on; None leaves it.
        path: that is uploaded before, and flown by a setpoint of `PathSetpoint`; None for none.
    """

    name: str
    kind: type[Setpoint]
    fields: Mapping[str, Any]
    seconds: float | None = None
    until: float | None = None
    wind: WindClass | None = None
    path: PathUploadRequest | None = None


def over_pad(name: str, east: float, seconds: float | None = None, **more: Any) -> FlightPart:
    """Hold a place `east` of the middle of the target [m], `HEIGHT` above it."""
    fields = {"position": (east, 0.0, HEIGHT), "frame": SetpointFrame.PAD}
    return FlightPart(name, PositionSetpoint, fields, seconds, **more)


def take_off() -> FlightPart:
    """Climb to `HEIGHT`."""
    return FlightPart("take-off", TakeOffSetpoint, {"height": HEIGHT})


def land() -> FlightPart:
    """Land on the target."""
    return FlightPart("land", LandSetpoint, {})


def over_goal(name: str, east: float, north: float, seconds: float | None = None) -> FlightPart:
    """Hold a place of the room, from the middle of the pad that is landed on [m], `HEIGHT` above it."""
    fields = {"position": (east, north, HEIGHT), "frame": SetpointFrame.PAD, "target": GOAL}
    return FlightPart(name, PositionSetpoint, fields, seconds)


EIGHT: Final = 0.7
"""Mean speed along the figure of eight [m/s]: 1.0 in its middle, and 1.1 m/s2 in the bends."""
ROOM_FLIGHT: Final = (
    FlightPart("take-off", TakeOffSetpoint, {"height": HEIGHT, "target": GOAL}),
    over_goal("hold", 0.0, 0.0, 8.0),
    over_goal("back", -0.5 * AWAY, 0.5),
    over_goal("midway", -0.5 * AWAY, 0.5, 6.0),
    FlightPart("eight", PathSetpoint, {"target": GOAL}, path=figure_of_eight(EIGHT, 1, HEIGHT)),
    over_goal("return", 0.0, 0.0),
    FlightPart("land", LandSetpoint, {"target": GOAL}),
)
"""What is flown in a room: a take-off that names the other pad crosses to it, half the way back, an eight, landing."""
ROOM_FENCE: Final = AWAY + 2.0
"""Radius of the fence around the pad that is landed on [m]."""
DEMONSTRATION: Final = (
    take_off(),
    over_pad("hold", 0.0, 12.0),
    over_pad("aside", -0.5),
    over_pad("step", 0.5, 6.0),
    over_pad("back", 0.0),
    over_pad("wait", 0.0, until=PAD_STARTS + 1.0),
    over_pad("follow", 0.0, 8.0),
    land(),
)
"""What the demonstration flies."""


class FlyingAircraft(Aircraft, Protocol):
    """Boards at the end of a cable, and the world they fly in."""

    @property
    def world(self) -> World:
        """Airframe, air, pilot and faults."""


class Rehearsal:
    """One flight in virtual time.

    Attributes:
        record: what happened.
        bus: where the daemon stands, and the client that flies.
        clock: virtual time.
    """

    def __init__(
        self,
        config: SimConfig,
        aircraft: FlyingAircraft,
        watcher: Watcher,
        parts: Sequence[FlightPart] = DEMONSTRATION,
        *,
        tagmaps: tuple[TagMap, TagMap] | None = None,
        fence: float | None = None,
        limits: Mapping[str, float] = MappingProxyType({}),
        moved: Callable[[float], None] = lambda now: None,
        calibrated: Callable[[Intrinsics], Intrinsics] = lambda lens: lens,
    ) -> None:
        """Set everything up; needs a running loop.

        Args:
            config: what is simulated: scene, and the seed of everything random.
            aircraft: boards and world, at the end of the daemon's cable.
            watcher: sees the flight.
            parts: what is flown.
            tagmaps: the targets as they are, and as vision knows them; None for those of `config`, nested without any.
            fence: radius of the fence around the target [m]; None for the daemon's own.
            limits: other values of `control.autopilot`.
            moved: called after every step of the world with the time [s].
            calibrated: the calibration that vision uses of the lens through which images are rendered.
        """
        loop = asyncio.get_running_loop()
        world, seed = aircraft.world, config.seed
        self.record, self.bus = Rehearsed(), LocalBus()
        self._world, self._watcher, self._loop = world, watcher, loop
        self._watch_world = moved
        seen, known = tagmaps or (None, nested_map())
        self._scene = SceneCamera(config.scene, seed, seen, walls=config.flight.walls)
        eyes: list[RehearsedEyes] = []

        def make_eyes(feed: Feed) -> RehearsedEyes:
            lens = calibrated(self._scene.camera.intrinsics)
            eyes.append(RehearsedEyes(self._scene, world, feed, self.clock, seed, self.bus, lens, known))
            return eyes[0]

        self.clock = virtual_clock()
        daemon = virtual_config(**limits) if fence is None else virtual_config(fence_radius=fence, **limits)
        line = Cable(aircraft, self._moved).open
        self._daemon = VirtualDaemon(self.bus, line, config=daemon, clock=self.clock, eyes=make_eyes)
        self._wiring = self._daemon.wiring
        (self._eyes,) = eyes
        self._parts = parts
        self._part = ""
        self._kept_at = 0.0

    @property
    def scene(self) -> SceneCamera:
        """What the camera sees."""
        return self._scene

    @property
    def world(self) -> World:
        """Airframe, air and pilot."""
        return self._world

    def watch_world(self, moved: Callable[[float], None]) -> None:
        """Call a function after every step of the world with the time [s], in place of the one given at first."""
        self._watch_world = moved

    def watch(self, follow: Show) -> None:
        """Report every value, also the camera's view."""
        self.bus.followers.append(follow)
        self._eyes.is_watched = True

    async def fly(self) -> Rehearsed:
        """Fly from the pilot's start of the motors to motors that stand still; the record."""
        self._daemon.start()
        seeing = asyncio.create_task(self._eyes.run(), name="eyes")
        try:
            self._begin("start")
            if await self._wait(self._is_ready, READY):
                await self.bus.take_lease("demo")
                await self._wait(lambda: self._is_leased, 1.0)
                await self._fly_parts()
                status = self._value("control/status", ControlStatus)
                self.record.outcome = "" if status is None else status.reason
                self._begin("after")
                await self._wait(lambda: self._wiring.facts.motors_running(self._loop.time()) is False, 10.0)
            self.record.motors_stand = self._wiring.facts.motors_running(self._loop.time()) is False
        finally:
            seeing.cancel()
            await asyncio.gather(seeing, return_exceptions=True)
            await self._daemon.stop()
        self.record.crashed = self._world.truth.crash_reason
        self.record.images, self.record.posed = self._eyes.images, self._eyes.posed
        return self.record

    # -- the parts of the flight ----------------------------------------------------------------------------------

    async def _fly_parts(self) -> None:
        await self._follow(self._parts)

    async def _follow(self, parts: Sequence[FlightPart]) -> bool:
        """Fly one part after the other; whether the flight goes on after the last."""
        for part in parts:
            self._begin(part.name)
            if part.wind is not None:
                self._world.change_wind(part.wind)
            seconds = part.seconds
            if part.until is not None:
                seconds = max(0.0, part.until - self._loop.time())
            fields = part.fields
            if part.path is not None:
                stored = await self.bus.ask("do/path_upload", **part.path.model_dump(exclude_defaults=True))
                fields = {**fields, "path": (stored.reply or {}).get("id", stored.token)}
            if not await self._stream(part.kind, fields, seconds):
                return False
        return True

    async def _stream(self, kind: type[Setpoint], fields: Mapping[str, Any], seconds: float | None) -> bool:
        """Stream a setpoint for some time, or until it is done; whether the flight goes on."""
        began = self._loop.time()
        while self._loop.time() - began < (LONGEST if seconds is None else seconds):
            self.bus.deliver(kind, self._loop.time(), *self.bus.sign_next(kind, fields))
            await asyncio.sleep(PERIOD)
            status = self._value("control/status", ControlStatus)
            if status is None or status.lease is None:
                return False
            is_new = status.stamp.monotonic - began > 2 * PERIOD  # the last part's status may stand there for longer
            if seconds is None and is_new and status.is_done and kind is not LandSetpoint:
                return True
        return seconds is not None

    @property
    def _is_leased(self) -> bool:
        status = self._value("control/status", ControlStatus)
        return status is not None and status.lease is not None

    def _value(self, suffix: str, kind: type[_Value]) -> _Value | None:
        """The last value of a key, None before the first."""
        value = self.bus.values.get(suffix)
        assert value is None or isinstance(value, kind)
        return value

    def _is_ready(self) -> bool:
        link, runs = self._wiring.link, self._wiring.facts.motors_running(self._loop.time())
        return bool(link.is_up and link.dialect.extern_control is not None and runs)

    async def _wait(self, claim: Callable[[], bool], within: float) -> bool:
        """Wait for a claim to hold; whether it did in time."""
        deadline = self._loop.time() + within
        while not claim():
            if self._loop.time() >= deadline:
                return False
            await asyncio.sleep(PERIOD)
        return True

    def _begin(self, part: str) -> None:
        self._part = part
        self.record.parts[part] = self._loop.time()

    def _moved(self, now: float) -> None:
        """Keep what is true now, twenty times a second."""
        self._watch_world(now)
        if now < self._kept_at:
            return
        self._kept_at = now + KEPT
        target = self._scene.platform.pose_at(now).position_enu
        x, y, z = (float(part) for part in self._world.truth.position_enu - target)
        east, north, up = (float(part) for part in target)
        error = self._value("control/error", ControlError)
        estimate = self._value("control/estimate", ControlEstimate)
        if error is not None and now - error.stamp.monotonic > OLD:
            error = None
        if estimate is not None and now - estimate.stamp.monotonic > OLD:
            estimate = None
        moment = Moment(
            at=now,
            position=(x, y, z),
            target=(east, north, up),
            goal=None if error is None else error.goal,
            estimate=None if estimate is None else estimate.position,
            part=self._part,
        )
        self.record.moments.append(moment)
        self._watcher(moment, self._value("control/status", ControlStatus))


async def rehearse(
    *,
    seed: int,
    wind: str,
    fps: float,
    watcher: Watcher,
    show_on: ShowOn | None = None,
    recording: Path | None = None,
    is_room: bool = False,
) -> Rehearsed:
    """Fly the demonstration once; see `Rehearsal`.

    Args:
        seed: of everything random.
        wind: none, indoor, light or moderate.
        fps: images a second.
        watcher: sees the flight.
        show_on: a bus on which clients look at it; None for none.
        recording: where its recording goes; None for none.
        is_room: fly through a room of tags, from one pad to another.

    Raises:
        MkError: the recording cannot be written.
    """
    tape = None if recording is None else FlightTape()
    make = room_demonstration if is_room else demonstration
    rehearsal = make(simulated_aircraft(seed, wind, fps), watcher, tape)
    with ExitStack() as stack:
        if show_on is not None:
            rehearsal.watch(stack.enter_context(show_on(rehearsal.bus, rehearsal.clock)))
        record = await rehearsal.fly()
    if tape is not None and recording is not None:
        tape.write(recording)
    return record


def demonstration(config: SimConfig, watcher: Watcher, tape: FlightTape | None = None) -> Rehearsal:
    """The demonstration with simulated boards; needs a running loop.

    Args:
        config: what is simulated.
        watcher: sees the flight.
        tape: records it; None for no recording.
    """
    return _taped(Rehearsal, config, Simulation(config, landing_world(config)), watcher, tape)


def room_demonstration(
    config: SimConfig,
    watcher: Watcher,
    tape: FlightTape | None = None,
    parts: Sequence[FlightPart] = ROOM_FLIGHT,
    *,
    limits: Mapping[str, float] = MappingProxyType({}),
    aircraft: FlyingAircraft | None = None,
) -> Rehearsal:
    """A flight through a room of tags that were surveyed, from one pad to the other; needs a running loop.

    Args:
        config: what is simulated; its platform is not used.
        watcher: sees the flight.
        tape: records it; None for no recording.
        parts: what is flown.
        limits: values of `control.autopilot` beside its fence.
        aircraft: what flies from the first pad, in place of the simulated boards; it is not recorded.
    """
    config = config.model_copy(update={"scene": config.scene.model_copy(update={"platform": PlatformConfig()})})
    maps = room_map(), room_map(survey=config.seed)
    make = partial(Rehearsal, parts=parts, tagmaps=maps, fence=ROOM_FENCE, limits=limits)
    if aircraft is not None:
        return make(config, aircraft, watcher)
    world = World(config.flight, seed=config.seed, start=StartState(east=-AWAY))
    return _taped(make, config, Simulation(config, world), watcher, tape)


def _taped(
    make: Callable[..., Rehearsal], config: SimConfig, simulation: Simulation, watcher: Watcher, tape: FlightTape | None
) -> Rehearsal:
    """A rehearsal that is recorded where there is a tape."""
    if tape is None:
        return make(config, simulation, watcher)
    rehearsal = make(config, simulation, watcher, moved=tape.follow(simulation))
    tape.begin(rehearsal.clock)
    rehearsal.watch(tape.take)
    return rehearsal

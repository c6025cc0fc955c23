"""The whole daemon over a target that it sees through a rendered camera, in real time.

`mkdaemon sim` and `mkdaemon run` are processes of their own, started as a user starts them. The simulated pilot takes
off by hand and hovers.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

from lab.places import ROOT
from lab.rigs.processes import MKCTL, PROGRAM, START, DaemonProcess, Program, connected, start_daemon, wait_for_control
from lab.rigs.waiting import following, wait_for
from lab.rigs.wiretap import WireTap, tapped
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.client import Sample, Vehicle

VEHICLE: Final = "mk1"
HEIGHT: Final = 2.0
"""Where it holds above the target [m]."""
TAKE_OFF: Final = 120.0
"""Longest wait for the pilot to hover with the target in sight [s]; half a minute on an idle machine."""
ENGAGED: Final = 60.0
"""Longest wait until the daemon flies [s]."""
NOT_OURS: Final = -10
"""Nice value of the simulator and of the operator's program, where they may have one: an aircraft, and an operator's
own computer, do not stand still because this one is busy."""

SHIPPED: Final = ROOT / "configs" / "sim-vision.toml"
"""The configuration that is flown, but for the rate of the images, the wind and the pilot."""


class Made(NamedTuple):
    """A stick frame that the daemon made.

    Attributes:
        number: of the frame, 1 to 255.
        image: when the newest image it rests on was taken [s; monotonic].
        at: when it was handed to the line [s; monotonic].
    """

    number: int
    image: float
    at: float


@dataclass(slots=True)
class Seen:
    """What an observer received, and when it was on the bus.

    Attributes:
        truths: time [s; monotonic] and true position [m; ENU], while the daemon's sticks act.
        latencies: from the exposure to the pose [s].
        phases: phase and reason, on every change.
        captures: when the images were taken in which a target was found [s; monotonic].
        deliveries: how much later the camera had delivered each of them [s].
        frames: every stick frame that rests on an image.
        failsafes: what the ladder did.
    """

    truths: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)
    failsafes: list[str] = field(default_factory=list)
    captures: list[float] = field(default_factory=list)
    deliveries: list[float] = field(default_factory=list)
    frames: list[Made] = field(default_factory=list)
    last: dict[str, dict[str, Any]] = field(default_factory=dict)

    def take(self, sample: Sample) -> None:
        """Keep what counts."""
        fields = self.last[sample.suffix] = sample.fields
        at = float(fields["stamp"]["monotonic"]) if "stamp" in fields else math.nan
        match sample.suffix:
            case "sim/truth" if fields["controlled"]:
                self.truths.append((at, tuple(fields["position_enu"])))
            case "vision/down/pose":
                self.latencies.append(float(fields["latency"]))
                self.deliveries.append(float(fields["delivered"]))
                self.captures.append(at)
            case "control/estimate" if (output := self.last.get("control/output")) is not None:
                made = float(output["stamp"]["monotonic"])
                self.frames.append(Made(output["frame"], at - float(fields["image_age"]), made))
            case "control/status":
                words = f"{fields['phase']}: {fields['reason']}"
                if not self.phases or self.phases[-1] != words:
                    self.phases.append(words)
            case "event/failsafe":
                self.failsafes.append(f"{fields['action']}: {fields['reason']}")

    @property
    def is_flying(self) -> bool:
        """Whether the daemon flies."""
        return bool(self.phases) and self.phases[-1].startswith("flying")

    def is_hovering(self) -> bool:
        """Whether the pilot hovers and the eyes see the target."""
        truth, pose = self.last.get("sim/truth"), self.last.get("vision/down/pose")
        if truth is None or pose is None:
            return False
        still = math.hypot(*truth["velocity_enu"]) < 0.3
        return bool(still and truth["position_enu"][2] > HEIGHT - 0.4)


@dataclass(frozen=True, slots=True)
class Setting:
    """How it is flown.

    Attributes:
        fps: images a second.
        wind: none, indoor, light or moderate.
        latency_ms: from the middle of the exposure until the camera delivers the image [ms].
        jitter_ms: standard deviation of that [ms].
        is_tapped: what the daemon writes is noted with its times.
        pilot: what he does when he is asked to begin: `supervise` hovers by hand, `start` starts the motors alone.
        board: whose port it is, `nc` or `fc`; behind a NaviCtrl 0.24 there are 40 stick frames a second at most.
    """

    fps: float = 15.0
    wind: str = "indoor"
    seed: int = 1
    latency_ms: float = 60.0
    jitter_ms: float = 5.0
    is_tapped: bool = False
    board: str = "nc"
    pilot: str = "supervise"


@dataclass(frozen=True, slots=True)
class Hover:
    """An aircraft that its pilot holds by hand over the target, ready to hand it over.

    Attributes:
        endpoint: where the daemon's bus listens.
        simulator: number of its process.
        tap: on the line, where the setting asks for one.
    """

    endpoint: str
    daemon: DaemonProcess
    client: Vehicle
    seen: Seen
    simulator: int
    tap: WireTap | None

    async def hold(self, seconds: float) -> Program:
        """Let an operator's program of its own hold the place over the target; returns when the daemon flies.

        Raises:
            TimeoutError: it did not.
        """
        place = ("--height", str(HEIGHT), "--seconds", str(seconds), "--vehicle", VEHICLE, "--connect", self.endpoint)
        operator = await Program.start(*MKCTL, "hold", *place, is_read=False)
        favour(operator.pid)
        await wait_for(lambda: self.seen.is_flying, ENGAGED, 0.05)
        return operator


@asynccontextmanager
async def hovering(setting: Setting = Setting()) -> AsyncIterator[Hover]:
    """Simulator and daemon as processes, for as long as the context lasts; the pilot hovers over the target.

    Raises:
        TimeoutError: the pilot did not come to hover with the target in sight.
    """
    async with over_target(setting) as hover:
        await wait_for(hover.seen.is_hovering, TAKE_OFF, 0.1)
        yield hover


@asynccontextmanager
async def over_target(setting: Setting) -> AsyncIterator[Hover]:
    """Simulator and daemon as processes, for as long as the context lasts; the pilot has been asked to begin.

    Raises:
        TimeoutError: the daemon cannot control the aircraft, or the simulator does not answer.
    """
    seen = Seen()
    async with AsyncExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        endpoint = stack.enter_context(reserved_endpoint())
        where = stack.enter_context(reserved_endpoint()).removeprefix("tcp/")
        config = _config(folder, setting, endpoint)
        # Its boards are behind a TCP port: lab/rigs/live.py says why.
        simulator = await Program.start(*PROGRAM, "sim", "--config", str(config), "--listen", where)
        stack.push_async_callback(simulator.end)
        favour(simulator.pid)  # its threads, started later, inherit it
        await simulator.first_line()  # it serves
        tap = await stack.enter_async_context(tapped(where)) if setting.is_tapped else None
        _name_port(config, f"tcp:{where}" if tap is None else tap.port)
        daemon = await start_daemon(config, endpoint)
        stack.callback(lambda: sys.stderr.write(daemon.errors))
        stack.push_async_callback(daemon.end, signal.SIGINT)
        client = await stack.enter_async_context(connected(endpoint, VEHICLE, patience=START))
        keys = ("sim/truth", "vision/down/pose", "control/*", "event/failsafe")
        await stack.enter_async_context(following(client, seen.take, *keys))
        await wait_for_control(client)
        await wait_for(lambda: "sim/truth" in seen.last)
        await client.command("sim", "start")
        yield Hover(endpoint, daemon, client, seen, simulator.pid, tap)


def _config(folder: Path, setting: Setting, endpoint: str) -> Path:
    """Write the configuration of both programs; returns the file."""
    text = SHIPPED.read_text(encoding="utf-8")
    pilot = f'pilot_plan = "{setting.pilot}"\npilot_wait = {TAKE_OFF}\nseed = {setting.seed}\nconnect = ["{endpoint}"]'
    for old, new in (
        ('"configs/', f'"{ROOT}/configs/'),
        ("fps = 30", f"fps = {setting.fps:g}"),
        ("latency_ms = 60.0", f"latency_ms = {setting.latency_ms:g}"),
        ("latency_jitter_ms = 5.0", f"latency_jitter_ms = {setting.jitter_ms:g}"),
        ('pilot_plan = "hover"', pilot),
        ('name = "mk1"', f'name = "{VEHICLE}"\nstate_folder = "{folder}"'),
        ("[sim.scene]", f'board = "{setting.board}"\n\n[sim.scene]'),
        ("[sim.scene.platform]", f'[sim.flight]\nwind = "{setting.wind}"\n\n[sim.scene.platform]'),
    ):
        if old not in text:
            msg = f"{SHIPPED}: {old!r} is not there any more"
            raise ValueError(msg)
        text = text.replace(old, new)
    config = folder / "fly.toml"
    config.write_text(text, encoding="utf-8")
    return config


def favour(process: int) -> None:
    """Put a process, the only one of its session, before other programs, where that is allowed."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process, NOT_OURS)
        Path(f"/proc/{process}/autogroup").write_text(str(NOT_OURS), encoding="ascii")


def _name_port(config: Path, port: str) -> None:
    with config.open("a", encoding="utf-8") as file:
        file.write(f'\n[link]\nport = "{port}"\n')

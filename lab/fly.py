"""`python -m lab fly`: the whole daemon flies over a target it sees through a rendered camera, in real time.

`mkdaemon sim` and `mkdaemon run` are processes of their own, started as a user starts them. The simulated pilot takes
off by hand and hovers; a client streams position setpoints, the aircraft holds over the target, then is released.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from lab.places import ROOT
from lab.rigs.processes import DaemonProcess, connected, wait_for_control
from lab.rigs.waiting import wait_for
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client import Sample, Vehicle
from mkdaemon.errors import MkError

VEHICLE: Final = "mk1"
HEIGHT: Final = 2.0
"""Where it holds above the target [m]."""
SETTLING: Final = 6.0
"""Figures are taken after this much of the flight [s]."""
TAKE_OFF: Final = 120.0
"""Longest wait for the pilot to hover with the target in sight [s]; half a minute on an idle machine."""
LARGEST: Final = 0.5
"""Farthest from the goal at any moment of the hold [m]."""
REAL_AIRCRAFT: Final = -10
"""Nice value of the simulator, where it may have one: an aircraft does not stand still because a computer is busy."""
PERIOD: Final = 0.02
"""Of stick frames [s]."""

SHIPPED: Final = ROOT / "configs" / "sim-vision.toml"
"""The configuration that is flown, but for the rate of the images, the wind and the pilot."""


@dataclass(slots=True)
class Seen:
    """What an observer received, and when it was on the bus.

    Attributes:
        truths: time [s; monotonic] and true position [m; ENU], while the daemon's sticks act.
        steps: when the simulator published its state [s; monotonic].
        latencies: from the exposure to the pose [s].
        outputs: when stick frames were made [s; monotonic].
        estimates: time [s; monotonic] and estimated position in the frame of the target [m].
        phases: phase and reason, on every change.
        failsafes: what the ladder did.
    """

    truths: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    outputs: list[float] = field(default_factory=list)
    estimates: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)
    failsafes: list[str] = field(default_factory=list)
    last: dict[str, dict[str, Any]] = field(default_factory=dict)

    def take(self, sample: Sample) -> None:
        """Keep what counts."""
        fields = self.last[sample.suffix] = sample.fields
        at = float(fields["stamp"]["monotonic"]) if "stamp" in fields else math.nan
        if sample.suffix == "sim/truth":
            self.steps.append(at)
        match sample.suffix:
            case "sim/truth" if fields["controlled"]:
                self.truths.append((at, tuple(fields["position_enu"])))
            case "vision/down/pose":
                self.latencies.append(float(fields["latency"]))
            case "control/output":
                self.outputs.append(at)
            case "control/estimate":
                self.estimates.append((at, tuple(fields["position"])))
            case "control/status":
                words = f"{fields['phase']}: {fields['reason']}"
                if not self.phases or self.phases[-1] != words:
                    self.phases.append(words)
            case "event/failsafe":
                self.failsafes.append(f"{fields['action']}: {fields['reason']}")

    def is_hovering(self) -> bool:
        """Whether the pilot hovers and the eyes see the target."""
        truth, pose = self.last.get("sim/truth"), self.last.get("vision/down/pose")
        if truth is None or pose is None:
            return False
        still = math.hypot(*truth["velocity_enu"]) < 0.3
        return bool(still and truth["position_enu"][2] > HEIGHT - 0.4)


def main(
    *,
    seconds: float = 20.0,
    fps: float = 15.0,
    wind: str = "indoor",
    seed: int = 1,
    as_json: AsJson = False,
) -> int:
    """Fly once, in real time; a minute. The goal is a hold within 0.5 m after the first seconds.

    Args:
        seconds: how long the machine flies.
        fps: images a second.
        wind: none, indoor, light or moderate.
        seed: of the simulator.
    """
    figures = asyncio.run(fly(seconds, fps, wind, seed))
    if as_json:
        print(json.dumps(figures))
    else:
        for name, value in figures.items():
            print(f"{name:<24} {value}")
    return 0 if figures["holds"] else 1


async def fly(seconds: float, fps: float, wind: str, seed: int) -> dict[str, Any]:
    """Fly once; the figures. See `main`.

    Raises:
        TimeoutError: the pilot did not come to hover with the target in sight.
    """
    async with hovering(fps, wind, seed) as hover:
        daemon, client, seen = hover.daemon, hover.client, hover.seen
        began, share, lost = math.nan, math.nan, ""
        try:
            async with client.lease() as lease:
                await lease.velocity(0.0, 0.0, 0.0, seconds=0.1)
                began, cpu = asyncio.get_running_loop().time(), daemon.cpu_s()
                await lease.position(0.0, 0.0, HEIGHT, seconds=seconds)
                share = (daemon.cpu_s() - cpu) / (asyncio.get_running_loop().time() - began)
        except MkError as error:
            lost = str(error)
        await wait_for(lambda: seen.phases[-1].startswith("free"), 10.0, 0.05)
        stats = seen.last.get("vision/down/stats", {})
    return build_figures(seen, began, share, lost) | {
        "image_rate": round(stats.get("fps", 0.0), 1),
        "images_lost": stats.get("lost", 0),
        "phases": seen.phases,
        "failsafes": seen.failsafes,
    }


@dataclass(frozen=True, slots=True)
class Hover:
    """An aircraft that its pilot holds by hand over the target, ready to hand it over.

    Attributes:
        endpoint: where the daemon's bus listens.
        daemon: its process.
        client: of the daemon.
        seen: what an observer receives.
    """

    endpoint: str
    daemon: DaemonProcess
    client: Vehicle
    seen: Seen


@asynccontextmanager
async def hovering(fps: float = 15.0, wind: str = "indoor", seed: int = 1) -> AsyncIterator[Hover]:
    """Simulator and daemon as processes, for as long as the context lasts.

    Raises:
        TimeoutError: the pilot did not come to hover with the target in sight.
    """
    seen = Seen()
    with tempfile.TemporaryDirectory() as folder, reserved_endpoint() as endpoint:
        config = _config(Path(folder), fps, wind, seed, endpoint)
        async with _running(config, endpoint) as (daemon, client), _observing(client, seen):
            await wait_for_control(client)
            await wait_for(lambda: "sim/truth" in seen.last)
            await client.command("sim", "start")
            await wait_for(seen.is_hovering, TAKE_OFF, 0.1)
            yield Hover(endpoint, daemon, client, seen)


def _config(folder: Path, fps: float, wind: str, seed: int, endpoint: str) -> Path:
    """Write the configuration of both programs; returns the file."""
    text = SHIPPED.read_text(encoding="utf-8")
    for old, new in (
        ('"configs/', f'"{ROOT}/configs/'),
        ("fps = 30", f"fps = {fps:g}"),
        (
            'pilot_plan = "hover"',
            f'pilot_plan = "supervise"\npilot_wait = {TAKE_OFF}\nseed = {seed}\nconnect = ["{endpoint}"]',
        ),
        ('name = "mk1"', f'name = "{VEHICLE}"\nstate_folder = "{folder}"'),
        ("[sim.scene.platform]", f'[sim.flight]\nwind = "{wind}"\n\n[sim.scene.platform]'),
    ):
        if old not in text:
            msg = f"{SHIPPED}: {old!r} is not there any more"
            raise ValueError(msg)
        text = text.replace(old, new)
    config = folder / "fly.toml"
    config.write_text(text, encoding="utf-8")
    return config


def _name_port(config: Path, port: str) -> None:
    with config.open("a", encoding="utf-8") as file:
        file.write(f'\n[link]\nport = "{port}"\n')


@asynccontextmanager
async def _running(config: Path, endpoint: str) -> AsyncIterator[tuple[DaemonProcess, Vehicle]]:
    """The simulator, the daemon and a client of it."""
    simulator = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "mkdaemon.cli.mkdaemon.app", "sim", "--config", str(config)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        with suppress(PermissionError):  # its threads, started later, inherit it
            os.setpriority(os.PRIO_PROCESS, simulator.pid, REAL_AIRCRAFT)
        assert simulator.stdout is not None
        port = json.loads(await simulator.stdout.readline())["port"]
        _name_port(config, port)
        daemon = await DaemonProcess.start(config, endpoint)
        try:
            async with connected(endpoint, VEHICLE) as client:
                yield daemon, client
        finally:
            await daemon.end(signal.SIGINT)
            sys.stderr.write(daemon.errors)
    finally:
        simulator.terminate()
        await simulator.wait()


@asynccontextmanager
async def _observing(client: Vehicle, seen: Seen) -> AsyncIterator[None]:
    async def listen() -> None:
        keys = ("sim/truth", "vision/down/pose", "vision/down/stats", "control/*", "event/failsafe")
        async with client.watch(*keys) as samples:
            async for sample in samples:
                seen.take(sample)

    listening = asyncio.create_task(listen(), name="observer")
    try:
        yield
    finally:
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)


def build_figures(seen: Seen, began: float, share: float, lost: str) -> dict[str, Any]:
    """What was measured; the loop's time is the bus's monotonic time on one machine."""
    held = np.array([place for at, place in seen.truths if at > began + SETTLING] or [(math.nan,) * 3])
    errors = held - (0.0, 0.0, HEIGHT)
    level = np.hypot(errors[:, 0], errors[:, 1])
    gaps = np.diff([at for at in seen.outputs if at > began] or [math.nan])
    farthest = float(np.linalg.norm(errors, axis=1).max())
    return {
        "hover_rms_cm": _rounded(100 * math.sqrt(float((level**2).mean()))),
        "hover_max_cm": _rounded(100 * farthest),
        "height_rms_cm": _rounded(100 * math.sqrt(float((errors[:, 2] ** 2).mean()))),
        "held_s": _rounded(seen.truths[-1][0] - began - SETTLING) if len(held) > 1 else 0.0,
        "image_latency_p50_ms": _percentile(seen.latencies, 50),
        "image_latency_p99_ms": _percentile(seen.latencies, 99),
        "control_jitter_p50_ms": _percentile(np.abs(gaps - PERIOD), 50),
        "control_jitter_p99_ms": _percentile(np.abs(gaps - PERIOD), 99),
        "frame_gap_max_ms": _percentile(gaps, 100),
        "simulator_gap_max_ms": _percentile(np.diff([at for at in seen.steps if at > began]), 100),
        "daemon_cpu_percent": _rounded(100 * share),
        "lost": lost,
        "holds": not lost and farthest <= LARGEST,
    }


def _percentile(values: Any, share: float) -> float | None:
    return _rounded(1000 * float(np.percentile(values, share))) if len(values) else None


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 2)

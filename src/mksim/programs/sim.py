"""`mkdaemon sim`: the simulated aircraft on a pseudo terminal, for mkdaemon or any other program."""

from __future__ import annotations

import asyncio
import json
import signal
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import structlog
from cyclopts import Parameter

from mkdaemon.bus.names import key
from mkdaemon.cli.arguments import Length
from mkdaemon.cli.mkdaemon.logs import configure
from mkdaemon.cli.program import let_signals_kill
from mkdaemon.errors import ConfigError
from mksim.config import PilotPlan, SimulatorFile, load_simulator
from mksim.programs.sim_bus import sim_on_bus
from mksim.programs.sim_camera import CameraPublisher, open_camera, open_world, run_camera
from mksim.runtime import Runtime
from mksim.simulation import Simulation

_log = structlog.get_logger(__name__)
PILOTS: Final = f"The pilot {'; '.join(f'{plan}: {plan.does}' for plan in PilotPlan)}."
"""Help of `--pilot`."""


def sim(
    *,
    config: Annotated[Path | None, Parameter(help="Configuration file; section [sim] is read.")] = None,
    board: Annotated[
        Literal["nc", "fc"] | None, Parameter(help="Whose port: NaviCtrl (default) or FlightCtrl.")
    ] = None,
    fc: Annotated[str | None, Parameter(help="FlightCtrl release: early, 2.08, 2.12a, 2.14.")] = None,
    nc: Annotated[str | None, Parameter(help="NaviCtrl release: 0.24, 2.14.")] = None,
    seed: Annotated[int | None, Parameter(help="Random seed.")] = None,
    pilot: Annotated[str | None, Parameter(help=PILOTS)] = None,
    pilot_wait: Annotated[
        float | None,
        Parameter(help="Delay before the pilot uses the sticks, 20 by default [s]; `mkctl sim start` ends it."),
    ] = None,
    vehicle: Annotated[str | None, Parameter(help="Vehicle name of the keys of truth and faults.")] = None,
    connect: Annotated[str | None, Parameter(help="Zenoh endpoint of the daemon, for truth and faults.")] = None,
    listen: Annotated[str | None, Parameter(help="Also offer the port over TCP, host:port.")] = None,
    scene_only: Annotated[
        bool, Parameter(negative=(), help="Simulate only the camera; its pose comes from the bus.")
    ] = False,
    truth: Annotated[str | None, Parameter(help="With --scene-only: key of poses; default mk/NAME/sim/pose.")] = None,
    seconds: Annotated[Length | None, Parameter(help="End after this time [s]; default: on Ctrl-C.")] = None,
) -> None:
    """Simulate an aircraft. The first line on standard output is `{"port": "/dev/pts/N"}`: connect to that port.

    The boards behave as measured ones do: byte timing, losses, time-outs, dead-man. Faults: `mkctl sim fault`.
    With `--scene-only` another program flies, and publishes where its aircraft is; the first line is then
    `{"camera": KEY, "truth": KEY}`, and images come under the first key (docs/simulator.md).

    Example: mkdaemon sim --config configs/sim-vision.toml --pilot start

    Raises:
        ConfigError: an option, a file or an endpoint is wrong.
        LinkError: no port can be opened.
    """
    if truth is not None and not scene_only:
        msg = "--truth: only with --scene-only"
        raise ConfigError(msg)
    let_signals_kill()
    configure("info")
    given = {
        "sim.board": board,
        "sim.fc": fc,
        "sim.nc": nc,
        "sim.seed": seed,
        "sim.pilot_plan": pilot,
        "sim.pilot_wait": pilot_wait,
        "sim.listen": listen,
        "sim.connect": None if connect is None else [connect],
        "vehicle.name": vehicle,
    }
    overrides: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    whole = load_simulator(config, overrides)
    if "bus" in whole.model_fields_set:
        _log.info("[bus] is the daemon's, and not used here", file=str(config), connects_to=whole.sim.connect)
    asyncio.run(_film(whole, truth, seconds) if scene_only else _serve(whole, seconds))


def _stop_on_signals() -> asyncio.Event:
    """An event that the signals which end a program set."""
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    return stop


async def _film(config: SimulatorFile, truth: str | None, seconds: float | None) -> None:
    """Render poses of the bus until a signal comes or the time is over."""
    from mksim.programs.scene_only import film_poses

    stop, vehicle = _stop_on_signals(), config.vehicle.name
    where = truth or key(vehicle, "sim/pose")
    async with film_poses(config.sim, vehicle, where):
        camera = key(vehicle, f"sim/camera/{config.sim.scene.name}")
        print(json.dumps({"camera": camera, "truth": where}), flush=True)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await stop.wait()


async def _serve(config: SimulatorFile, seconds: float | None) -> None:
    """Run until a signal comes or the time is over."""
    stop = _stop_on_signals()
    simulation = Simulation(config.sim, open_world(config.sim))
    camera = open_camera(config.sim)
    runtime = Runtime(simulation, listen=config.sim.listen)
    publisher = CameraPublisher(config.vehicle.name, config.sim.scene.name, config.sim.scene.secret_file)
    async with (
        runtime.serve(),
        run_camera(camera, simulation, config.sim, publisher),
        sim_on_bus(simulation, config.sim, config.vehicle.name, publisher, port=runtime.port),
    ):
        print(json.dumps({"port": runtime.port}), flush=True)
        ends = [asyncio.ensure_future(event.wait()) for event in (stop, runtime.ended)]
        await asyncio.wait(ends, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        for end in ends:
            end.cancel()

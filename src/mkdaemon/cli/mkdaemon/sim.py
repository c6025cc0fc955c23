"""`mkdaemon sim`: the simulated aircraft on a pseudo terminal, for mkdaemon or any other program."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from mkdaemon.cli.arguments import require_length
from mkdaemon.cli.mkdaemon.logs import configure
from mkdaemon.cli.mkdaemon.sim_bus import sim_on_bus
from mkdaemon.cli.mkdaemon.sim_camera import CameraPublisher, open_camera, open_world, run_camera
from mkdaemon.cli.program import let_signals_kill
from mkdaemon.config.reader import load
from mkdaemon.config.root import Config
from mkdaemon.sim.runtime import Runtime
from mkdaemon.sim.simulation import Simulation


def sim(
    *,
    config: Annotated[Path | None, Parameter(help="Configuration file; section [sim] is read.")] = None,
    board: Annotated[
        Literal["nc", "fc"] | None, Parameter(help="Whose port: NaviCtrl (default) or FlightCtrl.")
    ] = None,
    fc: Annotated[str | None, Parameter(help="FlightCtrl release: early, 2.08, 2.12a, 2.14.")] = None,
    nc: Annotated[str | None, Parameter(help="NaviCtrl release: 0.24, 2.14.")] = None,
    seed: Annotated[int | None, Parameter(help="Of every random stream.")] = None,
    pilot: Annotated[str | None, Parameter(help="circle, hover, supervise, wait, nothing.")] = None,
    pilot_wait: Annotated[
        float | None,
        Parameter(help="Seconds before he touches the sticks, 20 by default; `mkctl sim start` asks him earlier."),
    ] = None,
    vehicle: Annotated[str | None, Parameter(help="Name under which truth and faults stand on the bus.")] = None,
    connect: Annotated[str | None, Parameter(help="Zenoh endpoint of the daemon, for truth and faults.")] = None,
    listen: Annotated[str | None, Parameter(help="Also offer the port over TCP, host:port.")] = None,
    seconds: Annotated[float | None, Parameter(help="End after so long; otherwise on Ctrl-C.")] = None,
) -> None:
    """Simulate an aircraft. The first line on standard output is `{"port": "/dev/pts/N"}`: connect to that port.

    The boards behave as measured ones do: byte timing, losses, time-outs, dead-man. Faults: `mkctl sim fault`.
    """
    let_signals_kill()
    configure("info")
    require_length(seconds, "--seconds")
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
    asyncio.run(_serve(load(config, overrides), seconds))


async def _serve(config: Config, seconds: float | None) -> None:
    """Run until a signal comes or the time is over."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    simulation = Simulation(config.sim, open_world(config.sim))
    camera = open_camera(config.sim)
    runtime = Runtime(simulation, listen=config.sim.listen)
    publisher = CameraPublisher(config.vehicle.name, config.sim.scene.name)
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

"""Makes the small recordings of tests/data: `python -m tools.recordings`, after a change of behaviour that is meant.

A whole daemon flies simulated boards in virtual time that is never on time (`lab/rigs`). The files are the same for the
same seeds and the same code.
"""

from __future__ import annotations

import asyncio
import logging
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import structlog

from lab.places import ROOT
from lab.rigs.blackbox import RecordedDaemon
from lab.rigs.boardport import LineFault
from lab.rigs.cockpit import Boards
from lab.rigs.recordedeyes import Part, fly_over_target, run_tardily
from mkdaemon.config.root import Config
from mkdaemon.telemetry.setpoint import HoldSetpoint, StickSetpoint, TakeOffSetpoint

FOLDER: Final = ROOT / "tests" / "data" / "recordings"
START: Final = 1000.0
"""Monotonic time at which they begin [s]."""
OVER_TARGET: Final = "fc_over_target"
"""The one with a camera."""
OVER_IT: Final = (Part(TakeOffSetpoint, 6.0, {"height": 1.0}), Part(HoldSetpoint, 0.7))
SEED: Final = 4
FPS: Final = 10.0
"""Images a second of the one with a camera."""
LIFTS_OFF: Final = 4.4
"""It begins to see then [s]: images of the ground under the standing aircraft take room."""
STREAMS: Final = {"attitude": 200, "debug": 250}


def flown_boards() -> dict[str, Boards]:
    """Name of each recording, and which aircraft flies."""
    return {"fc_sticks": Boards("2.12a"), "nc_lost_client": Boards("2.08", "0.24"), "fc_replugged": Boards("2.08")}


def make(name: str, folder: Path) -> RecordedDaemon:
    """Fly and record one; `folder` is for the daemon's state."""
    names = list(flown_boards())
    return run_tardily(_fly(name, flown_boards()[name], names.index(name) + 1, folder), names.index(name) + 1, START)


def _make_over_target(folder: Path) -> RecordedDaemon:
    """Fly over a target and record that with every image; `folder` is for the daemon's state."""
    return run_tardily(fly_over_target(OVER_IT, folder, seed=SEED, fps=FPS, dark=LIFTS_OFF), SEED, START)


async def _fly(name: str, boards: Boards, seed: int, folder: Path) -> RecordedDaemon:
    link: dict[str, Any] = {"port": "/dev/virtual", "rates": STREAMS}
    if boards.nc is not None:
        link["rates"] = {"attitude": 200, "osd": 250}
    vehicle = {"name": "t", "state_folder": folder}
    cfg = Config.model_validate({"vehicle": vehicle, "link": link, "bus": {"listen": ()}})
    daemon = RecordedDaemon(cfg, boards.make(seed), seed=seed)
    client = daemon.client
    await daemon.begin()
    await client.take_lease()
    await client.stream(StickSetpoint, 1.1, pitch=0, roll=0, yaw=0, throttle=-1)
    await client.stream(StickSetpoint, 0.4, pitch=12, roll=-7, yaw=0, throttle=-1)
    match name:
        case "fc_sticks":
            await client.give_back()
            await client.ask("do/rates", stream="debug", interval=0.1)
            await client.ask("cmd/fc/settings_request", index=255)
            await client.ask("do/nonsense")
        case "nc_lost_client":
            await client.vanish()
        case _:
            assert daemon.socket.port is not None
            daemon.socket.port.inject(LineFault.UNPLUGGED)
            await asyncio.sleep(0.5)
            daemon.socket.is_present = True
    await asyncio.sleep(0.5)
    await daemon.stop()
    return daemon


def main() -> None:
    """Make all of them."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in flown_boards():
        _write(FOLDER / f"{name}.mcap", partial(make, name))
    _write(FOLDER / f"{OVER_TARGET}.mcap", _make_over_target)


def _write(path: Path, fly: Callable[[Path], RecordedDaemon]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        fly(Path(folder)).write(path)
    print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    main()

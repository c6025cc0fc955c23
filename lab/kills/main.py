"""`python -m lab kills`: `kill -9` of mkctl and of the daemon at random moments of a settings backup and of a restore.

Real processes, the simulated FlightCtrl on a pseudo terminal. Afterwards (after the next start, where the daemon was
killed) the live parameter set must be byte-identical to what it was, and so must every stored set that was not to be
changed. The moments are drawn over the length of the procedure, measured first.
"""

from __future__ import annotations

import asyncio
import json
import random
import signal
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from lab.kills.record import RESTORED, Contents, Cut, Kill, summarise
from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.processes import VEHICLE, DaemonProcess, ObservedSimulation, connected, daemon_process
from lab.rigs.waiting import PATIENCE
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client import Vehicle
from mkdaemon.client.settings_files import write_backup
from mkdaemon.errors import MkError
from mkdaemon.telemetry.settings import SettingsBackup, StoredSet
from mksim.config import PilotPlan, SimConfig
from mksim.runtime import Runtime

VERBS: Final = ("backup", "restore")
"""Procedures in which is killed."""
LOOK: Final = 0.1
"""Time between two looks at whether the live set is proven [s]."""


class Bench:
    """A simulated FlightCtrl whose five sets differ, and the daemon on it."""

    def __init__(self, seed: int, folder: Path) -> None:
        config = {"board": "fc", "fc": "2.12a", "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed}
        self.simulation = ObservedSimulation(SimConfig.model_validate(config), keeps=False)
        self.runtime = Runtime(self.simulation, tick=ADAPTER_TIME)
        self.port = f"pty:{self.runtime.port}"
        self.folder = folder
        self._rng = random.Random(f"{seed} sets")
        flight = self.simulation.flight
        for slot, raw in list(flight.eeprom.sets.items()):
            flight.eeprom.sets[slot] = raw[:50] + bytes((slot,)) + raw[51:]
        flight.load(flight.eeprom.active)

    def new_sets(self) -> dict[int, bytes]:
        """Other bytes for the sets to be restored, within what a FlightCtrl stores as it is."""
        sets = self.simulation.flight.eeprom.sets
        return {slot: sets[slot][:51] + self._rng.randbytes(3) + sets[slot][54:] for slot in RESTORED}

    def contents(self) -> Contents:
        """What the FlightCtrl holds now."""
        flight = self.simulation.flight
        return Contents(flight.live.raw, flight.eeprom.active, dict(flight.eeprom.sets))

    async def ask(self, uav: Vehicle, verb: str, wanted: dict[int, bytes]) -> None:
        """Ask for the procedure and wait for its end."""
        if verb == "backup":
            await uav.settings.backup()
        else:
            sets = [StoredSet(slot=slot, raw=raw) for slot, raw in wanted.items()]
            await uav.settings.restore(sets, confirm=True)


@asynccontextmanager
async def open_bench(seed: int) -> AsyncIterator[Bench]:
    """Run a simulated FlightCtrl while the context lasts."""
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(seed, Path(name))
        async with bench.runtime.serve():
            yield bench


async def measure(bench: Bench, uav: Vehicle, verbs: Sequence[str]) -> dict[str, float]:
    """How long each procedure takes when nobody is killed [s]."""
    lengths = {}
    for verb in verbs:
        began = time.monotonic()
        await bench.ask(uav, verb, bench.new_sets())
        lengths[verb] = time.monotonic() - began
    return lengths


async def kill_mkctl(bench: Bench, uav: Vehicle, endpoint: str, verb: str, seed: int, length: float) -> Kill:
    """Kill the program that asked; the daemon must bring the procedure to its end."""
    rng = random.Random(f"mkctl {verb} {seed}")
    wanted, before = bench.new_sets(), bench.contents()
    moment = rng.uniform(0.0, length)
    with tempfile.TemporaryDirectory() as name:
        words = ["backup", f"{name}/saved"]
        if verb == "restore":
            saved = SettingsBackup(
                firmware="2.12a", active=3, sets=tuple(StoredSet(slot=slot, raw=raw) for slot, raw in wanted.items())
            )
            write_backup(Path(name) / "wanted", saved, RESTORED)
            words = ["restore", f"{name}/wanted"]
        async with uav.watch("event/progress") as samples:
            program = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "mkdaemon.cli.mkctl.app", "settings", *words),
                *("--vehicle", VEHICLE, "--connect", endpoint),
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.DEVNULL,
            )
            async with asyncio.timeout(PATIENCE):
                first = await anext(samples)
                await asyncio.sleep(moment)
                with suppress(ProcessLookupError):
                    program.send_signal(signal.SIGKILL)
                at, other = time.monotonic(), bench.contents().live != before.live
                await program.wait()
                state = first.fields["state"]
                while state == "running":
                    state = (await anext(samples)).fields["state"]
    cut = Cut("mkctl", verb, seed, moment, before, wanted, other)
    return cut.judge(bench.contents(), time.monotonic() - at)


async def kill_daemon(bench: Bench, daemon: DaemonProcess, uav: Vehicle, verb: str, seed: int, length: float) -> Cut:
    """Begin a procedure and kill the daemon that runs it; what is left is judged after the next start."""
    rng = random.Random(f"daemon {verb} {seed}")
    wanted, before = bench.new_sets(), bench.contents()
    moment = rng.uniform(0.0, length)
    async with uav.watch("event/progress") as samples:
        asking = asyncio.create_task(bench.ask(uav, verb, wanted), name=verb)
        async with asyncio.timeout(PATIENCE):
            await anext(samples)
        await asyncio.sleep(moment)
        await daemon.end(signal.SIGKILL)
        other = bench.contents().live != before.live
        asking.cancel()
        await asyncio.gather(asking, return_exceptions=True)
    return Cut("daemon", verb, seed, moment, before, wanted, other)


async def wait_until_proven(uav: Vehicle) -> None:
    """Return when the daemon knows its FlightCtrl and owes it no live set.

    Raises:
        TimeoutError: it still does.
    """
    async with asyncio.timeout(PATIENCE):
        while True:
            with suppress(MkError):
                state = await uav.get("link/state")
                is_up = state is not None and state.fields["firmware"] and state.fields["condition"] == "up"
                if is_up and not (await uav.settings.recover()).notes:
                    return
            await asyncio.sleep(LOOK)


async def run_mkctl_kills(runs: int, seed: int, verbs: Sequence[str] = VERBS) -> AsyncIterator[Kill]:
    """Kill mkctl so many times in each of some procedures, beside one daemon."""
    async with (
        open_bench(seed) as bench,
        daemon_process(bench.port, bench.folder) as daemon,
        connected(daemon.endpoint) as uav,
    ):
        await wait_until_proven(uav)
        lengths = await measure(bench, uav, verbs)
        for number in range(runs):
            for verb, length in lengths.items():
                yield await kill_mkctl(bench, uav, daemon.endpoint, verb, seed + number, length)


async def run_daemon_kills(runs: int, seed: int, verbs: Sequence[str] = VERBS) -> AsyncIterator[Kill]:
    """Kill the daemon so many times in each of some procedures; each next one is the victim after it."""
    async with open_bench(seed) as bench:
        lengths: dict[str, float] = {}
        cut: Cut | None = None
        plan = [(verb, seed + number) for number in range(runs) for verb in verbs]
        for verb, number in [*plan, ("", 0)]:
            began = time.monotonic()
            async with daemon_process(bench.port, bench.folder) as daemon, connected(daemon.endpoint) as uav:
                await wait_until_proven(uav)
                if cut is not None:
                    yield cut.judge(bench.contents(), time.monotonic() - began)
                if not verb:
                    break
                lengths = lengths or await measure(bench, uav, verbs)
                cut = await kill_daemon(bench, daemon, uav, verb, number, lengths[verb])


async def _run(runs: int, seed: int) -> list[Kill]:
    kills = []
    for campaign in (run_mkctl_kills(runs, seed), run_daemon_kills(runs, seed)):
        async for kill in campaign:
            kills.append(kill)
            if kill.is_wrong:
                print(f"WRONG: {kill}", file=sys.stderr, flush=True)
    return kills


def main(
    *,
    runs: Annotated[int, Parameter(help="Kills of each victim in each procedure; four times as many in all.")] = 25,
    seed: Annotated[int, Parameter(help="Of the first run.")] = 0,
    as_json: AsJson = False,
) -> int:
    """Kill mkctl and the daemon during backups and restores; exit code 1 if a live set was not the same afterwards."""
    kills = asyncio.run(_run(runs, seed))
    rows = summarise(kills)
    if as_json:
        print(json.dumps({"kills": rows, "runs": [asdict(kill) for kill in kills]}))
    else:
        for row in rows:
            print(", ".join(f"{name} {value}" for name, value in row.items()))
    return 1 if any(kill.is_wrong for kill in kills) else 0

"""`python -m lab kills`: `kill -9` of mkctl and of the daemon at random moments of a settings backup and of a restore.

Real processes, the simulated FlightCtrl on a pseudo terminal. Afterwards (after the next start, where the daemon was
killed) the live parameter set must be byte-identical to what it was, and so must every stored set that was not to be
changed. The moments are drawn over the length of the procedure, measured first.
"""

from __future__ import annotations

import asyncio
import random
import signal
import tempfile
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from lab.campaign import Row
from lab.cases import Case, Figure, Flight, command, judged, largest, part, total
from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.flown import observed
from lab.rigs.processes import MKCTL, VEHICLE, DaemonProcess, Program, connected, daemon_process
from lab.rigs.waiting import PATIENCE
from mkdaemon.client import Vehicle
from mkdaemon.client.settings_files import write_backup
from mkdaemon.errors import MkError
from mkdaemon.telemetry.settings import SettingsBackup, StoredSet
from mksim.runtime import Runtime

VERBS: Final = ("backup", "restore")
"""Procedures in which is killed."""
LOOK: Final = 0.1
"""Time between two looks at whether the live set is proven [s]."""


RESTORED: Final = (1, 4)
"""Sets that a restore changes; the active one is another."""


class Contents(NamedTuple):
    """What a FlightCtrl holds.

    Attributes:
        live: bytes of the live set.
        active: number of the active set.
        sets: bytes of the stored sets.
    """

    live: bytes
    active: int
    sets: dict[int, bytes]


class Bench:
    """A simulated FlightCtrl whose five sets differ, and the daemon on it."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.simulation = observed(seed)
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


LIMITS: Final = {"is_live_changed": False, "are_others_changed": False, "is_half_written": False}
"""Of what a kill leaves; see `judge`."""


class Cut(NamedTuple):
    """A procedure that was cut off: what, when, what the FlightCtrl held, what was to be written, another set live."""

    verb: str
    moment: float
    before: Contents
    wanted: dict[int, bytes]
    was_other_set_live: bool


def judge(cut: Cut, after: Contents, took: float) -> Row:
    """Compare what is left with what was there.

    Returns:
        `was_other_set_live`, another set than the right one when it was killed; `is_live_changed`, the live set is not
        byte-identical in the end, or another one is active; `are_others_changed`, so is a stored set that was not to be
        changed; `is_half_written`, a set to be restored is neither the old one nor the new one; `took`, from the kill
        to the end of the procedure, or to the proof after the next start [s]; `moment`, from the first progress to the
        kill [s].
    """
    changed = RESTORED if cut.verb == "restore" else ()
    before = cut.before.sets
    return judged(
        LIMITS,
        moment=round(cut.moment, 3),
        was_other_set_live=cut.was_other_set_live,
        is_live_changed=(after.live, after.active) != (cut.before.live, cut.before.active),
        are_others_changed=any(after.sets[slot] != raw for slot, raw in before.items() if slot not in changed),
        is_half_written=any(after.sets[slot] not in (before[slot], cut.wanted[slot]) for slot in changed),
        took=round(took, 3),
    )


async def measure(bench: Bench, uav: Vehicle, verb: str) -> float:
    """How long a procedure takes when nobody is killed [s]."""
    began = time.monotonic()
    await bench.ask(uav, verb, bench.new_sets())
    return time.monotonic() - began


async def kill_mkctl(bench: Bench, uav: Vehicle, endpoint: str, verb: str, seed: int, length: float) -> Row:
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
            program = await Program.start(*MKCTL, "settings", *words, "--vehicle", VEHICLE, "--connect", endpoint)
            async with asyncio.timeout(PATIENCE):
                first = await anext(samples)
                await asyncio.sleep(moment)
                program.send_signal(signal.SIGKILL)
                at, other = time.monotonic(), bench.contents().live != before.live
                await program.end(signal.SIGKILL)
                state = first.fields["state"]
                while state == "running":
                    state = (await anext(samples)).fields["state"]
    return judge(Cut(verb, moment, before, wanted, other), bench.contents(), time.monotonic() - at)


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
    return Cut(verb, moment, before, wanted, other)


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


async def kill_mkctls(verb: str, runs: int, seed: int) -> list[Row]:
    """Kill mkctl so many times in a procedure, beside one daemon."""
    async with (
        open_bench(seed) as bench,
        daemon_process(bench.port, bench.folder) as daemon,
        connected(daemon.endpoint) as uav,
    ):
        await wait_until_proven(uav)
        length = await measure(bench, uav, verb)
        return [await kill_mkctl(bench, uav, daemon.endpoint, verb, seed + run, length) for run in range(runs)]


async def kill_daemons(verb: str, runs: int, seed: int) -> list[Row]:
    """Kill the daemon so many times in a procedure; each next one is the victim after it."""
    kills: list[Row] = []
    async with open_bench(seed) as bench:
        length, cut = 0.0, None
        for run in range(runs + 1):
            began = time.monotonic()
            async with daemon_process(bench.port, bench.folder) as daemon, connected(daemon.endpoint) as uav:
                await wait_until_proven(uav)
                if cut is not None:
                    kills.append(judge(cut, bench.contents(), time.monotonic() - began))
                if run < runs:
                    length = length or await measure(bench, uav, verb)
                    cut = await kill_daemon(bench, daemon, uav, verb, seed + run, length)
    return kills


FIGURES: Final[Mapping[str, Figure]] = {
    "live_set_changed": total("is_live_changed"),
    "other_sets_changed": total("are_others_changed"),
    "half_written": total("is_half_written"),
    "other_set_live_at_the_kill": total("was_other_set_live"),
    "until_proven_p50": part("took", 0.5),
    "until_proven_max": largest("took"),
}
CASES: Final = {
    victim: Case(
        lambda runs, first, kill=kill, victim=victim: [  # type: ignore[misc]  # each has its own
            Flight(f"{victim} killed during {verb}", "FC 2.12a", partial(kill, verb, runs or 25), first)
            for verb in VERBS
        ],
        FIGURES,
        longest=7200.0,
    )
    for victim, kill in (("mkctl", kill_mkctls), ("daemon", kill_daemons))
}

main: Final = command(
    "kills",
    CASES,
    """Kill mkctl and the daemon during backups and restores; exit code 1 if a live set was not the same afterwards.

    25 kills of each victim in each procedure, unless `--runs` says otherwise.
    """,
    first=0,
)

"""`python -m lab kills`: `kill -9` of mkctl and of the daemon at random moments of a settings backup and of a restore.

Real processes, the simulated FlightCtrl on a pseudo terminal. Afterwards (after the next start, where the daemon was
killed) the live parameter set must be byte-identical to what it was, and so must every stored set that was not to be
changed.
"""

from __future__ import annotations

import asyncio
import random
import signal
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from lab.campaign import Row
from lab.cases import Case, Figure, Flight, command, judged, largest, part, total
from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.flown import observed
from lab.rigs.processes import MKCTL, START, VEHICLE, ObservedSimulation, Program, connected, daemon_process
from lab.rigs.waiting import PATIENCE
from mkdaemon.client import Vehicle
from mkdaemon.client.settings_files import write_backup
from mkdaemon.errors import MkError
from mkdaemon.telemetry.settings import SettingsBackup, StoredSet
from mksim.runtime import Runtime

LENGTHS: Final = {"backup": 2.0, "restore": 6.0}
"""How long each procedure takes after its first progress [s]; a kill after its end harms nothing."""
RESTORED: Final = (1, 4)
"""Sets that a restore changes; the active one is another."""
LIMITS: Final = {"is_live_changed": False, "are_others_changed": False, "is_half_written": False}
"""Of what a kill leaves; see `kill`."""


class Contents(NamedTuple):
    """What a FlightCtrl holds.

    Attributes:
        live: bytes of the live set, and which one is active.
        sets: bytes of the stored sets.
    """

    live: tuple[bytes, int]
    sets: dict[int, bytes]

    @classmethod
    def of(cls, simulation: ObservedSimulation) -> Contents:
        """Those of a FlightCtrl now."""
        flight = simulation.flight
        return cls((flight.live.raw, flight.eeprom.active), dict(flight.eeprom.sets))


async def kill(victim: str, verb: str, seed: int) -> Row:
    """Let `mkctl` ask a daemon for a procedure, kill one of the two in the middle, and look what is left.

    Returns:
        `moment`, from the first progress to the kill [s]; `was_other_set_live`, another set than the right one then;
        `is_live_changed`, the live set is not byte-identical in the end, or another one is active;
        `are_others_changed`, so is a stored set that was not to be changed; `is_half_written`, a set to be restored is
        neither the old one nor the new one; `took`, from the kill to the end of the procedure, or to the proof after
        the next start [s].

    Raises:
        TimeoutError: the daemon did not start, or did not prove the live set.
    """
    rng, simulation = random.Random(f"{victim} {verb} {seed}"), observed(seed)
    flight = simulation.flight
    for slot, raw in list(flight.eeprom.sets.items()):  # all five differ
        flight.eeprom.sets[slot] = raw[:50] + bytes((slot,)) + raw[51:]
    flight.load(flight.eeprom.active)
    before = Contents.of(simulation)
    # Other bytes for the sets to be restored, within what a FlightCtrl stores as it is.
    wanted = {slot: before.sets[slot][:51] + rng.randbytes(3) + before.sets[slot][54:] for slot in RESTORED}
    moment, runtime = rng.uniform(0.0, LENGTHS[verb]), Runtime(simulation, tick=ADAPTER_TIME)
    with tempfile.TemporaryDirectory() as name:
        sets = tuple(StoredSet(slot=slot, raw=raw) for slot, raw in wanted.items())
        write_backup(Path(name) / "restore", SettingsBackup(firmware="2.12a", active=3, sets=sets), RESTORED)
        async with runtime.serve(), daemon_process(f"pty:{runtime.port}", Path(name)) as daemon:
            async with connected(daemon.endpoint, patience=START) as uav:
                await wait_until_proven(uav)
                async with uav.watch("event/progress") as samples:
                    words = ("settings", verb, f"{name}/{verb}", "--vehicle", VEHICLE, "--connect", daemon.endpoint)
                    program = await Program.start(*MKCTL, *words)
                    async with asyncio.timeout(PATIENCE):
                        state = (await anext(samples)).fields["state"]
                        await asyncio.sleep(moment)
                        was_live, at = Contents.of(simulation).live, time.monotonic()
                        await (program if victim == "mkctl" else daemon).end(signal.SIGKILL)
                        while victim == "mkctl" and state == "running":
                            state = (await anext(samples)).fields["state"]
            await program.end(signal.SIGKILL)
            if victim == "daemon":
                async with (
                    daemon_process(f"pty:{runtime.port}", Path(name), endpoint=daemon.endpoint),
                    connected(daemon.endpoint, patience=START) as uav,
                ):
                    await wait_until_proven(uav)
            took = time.monotonic() - at
    after, changed = Contents.of(simulation), RESTORED if verb == "restore" else ()
    return judged(
        LIMITS,
        moment=round(moment, 3),
        was_other_set_live=was_live != before.live,
        is_live_changed=after.live != before.live,
        are_others_changed=any(after.sets[slot] != raw for slot, raw in before.sets.items() if slot not in changed),
        is_half_written=any(after.sets[slot] not in (before.sets[slot], wanted[slot]) for slot in changed),
        took=round(took, 3),
    )


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
            await asyncio.sleep(0.1)


FIGURES: Final[Mapping[str, Figure]] = {
    "live_set_changed": total("is_live_changed"),
    "other_sets_changed": total("are_others_changed"),
    "half_written": total("is_half_written"),
    "other_set_live_at_the_kill": total("was_other_set_live"),
    "until_proven_p50": part("took", 0.5),
    "until_proven_max": largest("took"),
}


def _flights(victim: str, runs: int | None, first: int) -> list[Flight]:
    return [
        Flight(f"{victim} killed during {verb}", "FC 2.12a", partial(kill, victim, verb), seed)
        for verb in LENGTHS
        for seed in range(first, first + (runs or 25))
    ]


CASES: Final = {victim: Case(partial(_flights, victim), FIGURES) for victim in ("mkctl", "daemon")}

main: Final = command(
    "kills",
    CASES,
    """Kill mkctl and the daemon during backups and restores; exit code 1 if a live set was not the same afterwards.

    25 kills of each victim in each procedure, unless `--runs` says otherwise.
    """,
    first=0,
)

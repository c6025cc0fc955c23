"""`python -m lab attack`: the daemon is killed, aborted or frozen in flight, and nobody starts it again.

Real processes on a pseudo terminal, judged by what the simulated FlightCtrl holds: how long until its sticks are
neutral, how long until it is released, and that no stick frame follows. Only the guard can do that.
"""

from __future__ import annotations

import asyncio
import json
import math
import random
import signal
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from lab.rigs.pilot import Pilot
from lab.rigs.processes import ObservedSimulation, connected, daemon_process, wait_for_control
from lab.rigs.waiting import wait_until
from lab.stories.kill import steering
from mkdaemon.cli.arguments import AsJson
from mkdaemon.config.sim import PilotPlan, SimConfig
from mkdaemon.sim.runtime import Runtime

NEUTRAL_LIMIT: Final = 0.35
"""Sticks are neutral in the FlightCtrl this long after the attack [s]; docs/safety.md, "The guard"."""
RELEASE_LIMIT: Final = 1.1
"""The FlightCtrl is released this long after it [s]."""
WATCH: Final = 3.0
"""How long the boards are watched after the release [s]."""
ATTACKS: Final = (signal.SIGKILL, signal.SIGABRT, signal.SIGSTOP)
BOARDS: Final = (("early", None), ("2.08", None), ("2.12a", None), ("2.08", "0.24"), ("2.12a", "0.24"))
"""FlightCtrl, and the NaviCtrl in front of it."""


@dataclass(frozen=True, slots=True)
class Attack:
    """What one attack did.

    Attributes:
        boards: FlightCtrl and NaviCtrl.
        kind: the signal.
        neutral: until the FlightCtrl held neutral sticks or nothing [s].
        released: until it held nothing [s].
        steered: frames with a control bit that came after the release.
    """

    boards: str
    kind: str
    neutral: float
    released: float
    steered: int

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        return self.neutral > NEUTRAL_LIMIT or self.released > RELEASE_LIMIT or self.steered > 0


async def attack(fc: str, nc: str | None, kind: signal.Signals, *, seed: int) -> Attack:
    """Fly, attack the daemon, and watch the boards.

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    rng = random.Random(f"{seed} {fc} {nc} {kind.name}")
    board = {"board": "fc"} if nc is None else {"board": "nc", "nc": nc}
    fields = {**board, "fc": fc, "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed}
    simulation = ObservedSimulation(SimConfig.model_validate(fields))
    runtime = Runtime(simulation)
    with tempfile.TemporaryDirectory() as name:
        async with (
            runtime.serve(),
            daemon_process(f"pty:{runtime.port}", Path(name)) as daemon,
            connected(daemon.endpoint) as client,
            Pilot(client, "pilot") as pilot,
        ):
            await wait_for_control(client)
            await pilot.engage(lambda: simulation.is_controlled)
            pilot.sticks |= {"pitch": 40.0, "roll": -40.0}
            await wait_until(lambda: not _is_neutral(simulation))
            await asyncio.sleep(rng.uniform(0.2, 0.8))
            began = time.monotonic()
            daemon.send_signal(kind)
            neutral = asyncio.create_task(wait_until(lambda: _is_neutral(simulation)), name="neutral")
            await wait_until(lambda: not simulation.is_controlled)
            released = time.monotonic() - began
            simulation.heard.clear()
            await asyncio.sleep(WATCH)
            steered = steering(b"".join(data for _, data in simulation.heard)) + int(simulation.is_controlled)
            with suppress(ProcessLookupError):
                daemon.send_signal(signal.SIGKILL)
            boards = f"FC {fc}" if nc is None else f"FC {fc} behind NC {nc}"
            return Attack(boards, kind.name, round(await neutral, 3), round(released, 3), steered)


def _is_neutral(simulation: ObservedSimulation) -> bool:
    external = simulation.flight.external
    held = external.held
    return not external.is_valid or (held.pitch, held.roll, held.yaw) == (0, 0, 0)


def main(
    *,
    runs: Annotated[int, Parameter(help="Attacks of every kind on every pair of boards.")] = 10,
    seed: Annotated[int, Parameter(help="Of the moments; run k has seed + k.")] = 1,
    as_json: AsJson = False,
) -> int:
    """Kill, abort and freeze the daemon in flight; ten runs of each row take about 20 minutes.

    The last line of `--json` is one object.
    """
    rows = []
    for fc, nc in BOARDS:
        for kind in ATTACKS:
            found = [asyncio.run(attack(fc, nc, kind, seed=seed + k)) for k in range(runs)]
            rows.append(_row(found))
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    holds = all(row["holds"] for row in rows)
    if as_json:
        print(json.dumps({"rows": rows, "holds": holds}))
    else:
        _print(rows)
    return 0 if holds else 1


def _row(found: list[Attack]) -> dict[str, Any]:
    return {
        "boards": found[0].boards,
        "attack": found[0].kind,
        "runs": len(found),
        "neutral_max_s": max(one.neutral for one in found),
        "released_max_s": max(one.released for one in found),
        "released_median_s": sorted(one.released for one in found)[math.ceil(len(found) / 2) - 1],
        "steered": sum(one.steered for one in found),
        "wrong": [asdict(one) for one in found if one.is_wrong],
        "holds": not any(one.is_wrong for one in found),
    }


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table("boards", "attack", "runs", "neutral [s]", "released [s]", "stick frames after", "holds")
    for row in rows:
        cells = (row["boards"], row["attack"], row["runs"], row["neutral_max_s"], row["released_max_s"], row["steered"])
        table.add_row(*(str(cell) for cell in cells), "yes" if row["holds"] else "NO")
    Console().print(table)

"""`python -m lab stories`: the safety stories about link and release, run a thousand times against simulated boards.

Each case ends in rows of one table: what was tried, how often, what was measured, what the limit is. Everything in
virtual time is seeded and the same on every machine; `plug`, `kill`, `race` and `soak` run real processes.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from lab.rigs.cockpit import Boards
from lab.stories.cable import BACK, CLEARED, pull_cable
from lab.stories.clients import Loss as Lost
from lab.stories.clients import lose_clients
from lab.stories.deaths import NEUTRAL_TIME, RELEASE_TIME, Death, SilentRelease
from lab.stories.faults import FAULTS, VERDICT, Verdicts, judge_fault
from lab.stories.interruptions import run_reboots, run_restarts, run_standstills, run_swaps
from lab.stories.kill import END_TIME, SIGNALS, End, end_daemon
from lab.stories.losses import Losses, campaign, sessions, silence_log
from lab.stories.page import Row, write_page
from lab.stories.plug import Replugs, replug
from lab.stories.race import Race, race
from lab.stories.soak import Soak, soak
from mkdaemon.cli.arguments import AsJson

DIRECT: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"))
"""One FlightCtrl of each dead-man generation."""
BEHIND: Final = (Boards("early", "0.24"), Boards("2.08", "0.24"), Boards("2.12a", "0.24"), Boards("2.14", "2.14"))
"""The same behind a NaviCtrl that passes stick frames on, and the newest pair."""
UNRELEASED_WATCH: Final = 8.0
"""Longer than every dead-man [s]."""
CYCLES: Final = 20
"""Interruptions of the line a session."""

Case = Literal[
    "deaths", "unreleased", "clients", "cable", "swap", "reboot", "freeze", "restart", "plug", "kill", "race", "faults",
    "soak",
]  # fmt: skip


def run_client_deaths(runs: int | None, jobs: int) -> Iterator[Row]:
    """Clients that die while they fly."""
    for boards in DIRECT:
        yield loss_row(campaign(boards, runs or 1000, jobs=jobs))
    for boards in BEHIND:
        yield loss_row(campaign(boards, runs or 200, jobs=jobs))


def loss_row(losses: Losses) -> Row:
    """One line of a campaign of deaths."""
    figure = (
        f"neutral on the wire p99.9 {_ms(losses.wire_p999_ms)}, longest {_ms(losses.wire_max_ms)}; released in the FC "
        f"longest {_ms(losses.released_max_ms)}; {losses.relapses} stale stick frames after"
    )
    limit = f"{1000 * NEUTRAL_TIME:g} ms; {1000 * RELEASE_TIME:g} ms; 0"
    story = f"client dies ({'every way' if len(losses.ways) == len(Death) else ', '.join(losses.ways)})"
    return Row("deaths", story, losses.boards, losses.runs, figure, limit, losses.holds, asdict(losses))


def _ms(time: float | None) -> str:
    return "never" if time is None else f"{time:g} ms"


def run_deaths_without_release(runs: int | None, jobs: int) -> Iterator[Row]:
    """The same with the active release taken out: it must be seen to fail."""
    for boards in DIRECT:
        yield unreleased_row(
            campaign(boards, runs or 100, jobs=jobs, link_class=SilentRelease, watched=UNRELEASED_WATCH),
        )


def unreleased_row(losses: Losses) -> Row:
    """One line of the counter-proof."""
    by_itself = "" if losses.released_max_ms is None else f", the others by themselves in {losses.released_max_ms:g} ms"
    figure = (
        f"{len(losses.wrong)} of {losses.runs} deaths break the limits; in {losses.never_released} the FC still obeys "
        f"the dead client after {UNRELEASED_WATCH:g} s{by_itself}"
    )
    # An FC that drops sticks by itself whatever else is asked shows no such death, but late ones all the same.
    shown = len(losses.wrong) == losses.runs and ("2.12" in losses.boards or losses.never_released == losses.runs)
    story = "counter-proof: client dies, active release disabled"
    return Row("unreleased", story, losses.boards, losses.runs, figure, "must fail", shown, asdict(losses))


def run_process_deaths(runs: int | None, jobs: int) -> Iterator[Row]:
    """Client processes that are killed or stopped."""
    for boards in DIRECT:
        found = asyncio.run(lose_clients(boards.fc, runs or 20))
        for name in sorted({loss.signal for loss in found}):
            yield client_row(boards.name, name, [loss for loss in found if loss.signal == name])


def client_row(boards: str, name: str, found: list[Lost]) -> Row:
    """One line of client processes lost in the same way; the wire takes part of the limit, the FC samples later."""
    neutral, released = max(loss.neutral for loss in found), max(loss.released for loss in found)
    figure = f"neutral in the FC longest {1000 * neutral:.0f} ms, released longest {1000 * released:.0f} ms"
    limit = f"{1000 * NEUTRAL_TIME:g} ms; {1000 * RELEASE_TIME:g} ms"
    story = f"client process gets {name} (times from the signal)"
    is_right = neutral <= NEUTRAL_TIME and released <= RELEASE_TIME
    return Row(
        "clients", story, boards, len(found), figure, limit, is_right, {"losses": [asdict(one) for one in found]}
    )


def run_cable_cuts(runs: int | None, jobs: int) -> Iterator[Row]:
    """The line is interrupted while a client flies."""
    for boards in (*DIRECT, BEHIND[2]):
        parts = enumerate(sessions(runs or 200, CYCLES))
        found = [cycle for seed, cycles in parts for cycle in pull_cable(boards, seed, cycles=cycles)]
        back = [cycle.back for cycle in found if cycle.back is not None]
        wrong = [(number // CYCLES, cycle.number) for number, cycle in enumerate(found) if cycle.is_wrong]
        figure = (
            f"telemetry back longest {max(back):.2f} s; first a release in "
            f"{sum(cycle.first == 'release' for cycle in found)}; {sum(cycle.steered for cycle in found)} stick frames "
            f"after; {sum(cycle.is_held for cycle in found)} still held; an old tilt obeyed in "
            f"{sum(cycle.obeyed > 0.0 for cycle in found)}, longest {max(cycle.obeyed for cycle in found):.2f} s"
        )
        limit = f"{BACK:g} s; all; 0; 0; {CLEARED:g} s"
        detail = {"cuts": [asdict(cycle) for cycle in found if cycle.is_wrong], "wrong": wrong}
        yield Row("cable", "cable pulled or board rebooted in flight", boards.name, len(found), figure, limit,
                  not wrong, detail)  # fmt: skip


def run_replugs(runs: int | None, jobs: int) -> Iterator[Row]:
    """A pseudo terminal comes and goes under a daemon process."""
    yield plug_row(asyncio.run(replug(runs or 200)))


def plug_row(cycles: Replugs) -> Row:
    """The line of the replugs."""
    figure = (
        f"telemetry back median {cycles.back_p50:.2f} s, longest {cycles.back_max:.2f} s; first bytes not a release in "
        f"{len(cycles.not_release)}; descriptors {cycles.descriptors[0]} -> {cycles.descriptors[1]}; memory "
        f"{cycles.memory_mb[0]:.1f} -> {cycles.memory_mb[1]:.1f} MiB"
    )
    limit = f"{BACK:g} s; 0; flat; flat"
    return Row("plug", "unplugged and plugged in, on a pseudo terminal", "FC 2.12a behind NC 0.24", cycles.cycles,
               figure, limit, cycles.holds, asdict(cycles))  # fmt: skip


def run_daemon_ends(runs: int | None, jobs: int) -> Iterator[Row]:
    """The daemon's process ends while a client flies."""
    for number in SIGNALS:
        for boards in DIRECT:
            seeds = range(runs or 5)
            yield end_row([asyncio.run(end_daemon(boards.fc, number, seed=seed)) for seed in seeds])


def end_row(ends: list[End]) -> Row:
    """One line of ends by the same signal on the same boards."""
    name, fc = ends[0].signal, ends[0].fc
    held = f"last command held longest {max(end.held for end in ends):.2f} s"
    steered = sum(end.steered for end in ends)
    if name == "SIGKILL":
        releases = max(end.released or 0.0 for end in ends)
        figure = (
            f"the next start begins with a release in {sum(end.first == 'release' for end in ends)}; Config cleared "
            f"{1000 * releases:.0f} ms after it at the latest; {steered} stick frames after; {held}"
        )
        limit = f"{len(ends)}; -; 0; dead-man or next start"
    else:
        figure = (
            f"last frame a release in {sum(end.first == 'release' for end in ends)}; {held}; process gone in "
            f"{max(end.took for end in ends):.2f} s"
        )
        limit = f"{len(ends)}; {END_TIME:g} s; {END_TIME:g} s"
    is_right = not any(end.is_wrong for end in ends)
    detail = {"ends": [asdict(end) for end in ends]}
    return Row("kill", f"{name} while a client flies", f"FC {fc}", len(ends), figure, limit, is_right, detail)


def run_lease_race(runs: int | None, jobs: int) -> Iterator[Row]:
    """Two clients fight for the lease; a run is a second."""
    yield race_row(asyncio.run(race(float(runs or 120))))


def race_row(found: Race) -> Row:
    """The line of the race."""
    figure = (
        f"{found.frames} stick frames, {found.tilted} of them tilted: {found.foreign} of the old epoch; "
        f"{found.backwards} outputs back in epoch; {found.unseen} transmissions unseen"
    )
    story = f"two clients race for the lease ({found.takes} leases, {found.refused} refusals)"
    return Row("race", story, "FC 2.12a", found.takes, figure, "0; 0; 0", found.holds, asdict(found))


def run_line_faults(runs: int | None, jobs: int) -> Iterator[Row]:
    """Every named fault of the line."""
    for boards in (DIRECT[2], BEHIND[2]):
        for fault in FAULTS:
            yield fault_row(judge_fault(boards, fault, range(runs or 20)))


def fault_row(found: Verdicts) -> Row:
    """One line of a fault."""
    words = " or ".join(found.words)
    figure = f"`{words}` after {found.verdict_max_ms:g} ms at the latest; up again {found.back_max_s:g} s after its end"
    if found.words == ("up",):
        figure = "stays `up`"
    return Row("faults", f"line fault: {found.fault.replace('_', ' ')}", found.boards, found.runs, figure,
               f"{1000 * VERDICT:g} ms", found.holds, asdict(found))  # fmt: skip


def run_soak(seconds: float) -> Iterator[Row]:
    """Full load for a long time."""
    yield soak_row(asyncio.run(soak(seconds)))


def soak_row(found: Soak) -> Row:
    """The line of the soak."""
    figure = (
        f"received {found.daemon_received} of {found.board_sent}, by the board {found.board_received} of "
        f"{found.daemon_sent} ({found.sticks} sticks); {found.tracebacks} tracebacks; memory "
        f"{found.memory_mb[0]:.1f} -> {found.memory_mb[1]:.1f} MiB; descriptors {found.descriptors[0]} -> "
        f"{found.descriptors[1]}; CPU {found.cpu_percent:g} %"
    )
    story = f"soak of {found.seconds:g} s"
    detail = asdict(found) | {"faults": found.faults()}
    return Row("soak", story, "FC 2.12a behind NC 0.24", 1, figure, "equal; equal; 0; flat; flat; 25 %",
               not found.faults() and found.cpu_percent <= 25.0, detail)  # fmt: skip


_CASES: Final[dict[str, Callable[[int | None, int], Iterator[Row]]]] = {
    "deaths": run_client_deaths,
    "unreleased": run_deaths_without_release,
    "clients": run_process_deaths,
    "cable": run_cable_cuts,
    "swap": run_swaps,
    "reboot": run_reboots,
    "freeze": run_standstills,
    "restart": run_restarts,
    "plug": run_replugs,
    "kill": run_daemon_ends,
    "race": run_lease_race,
    "faults": run_line_faults,
}


def main(
    *,
    case: Annotated[Case | None, Parameter(help="One case; all by default.")] = None,
    runs: Annotated[int | None, Parameter(help="Runs of every row, in place of each case's own.")] = None,
    seconds: Annotated[float, Parameter(help="Length of the soak [s].")] = 1200.0,
    jobs: Annotated[int, Parameter(help="Processes for campaigns in virtual time.")] = 1,
    page: Annotated[Path | None, Parameter(help="Markdown page whose rows of these cases are replaced.")] = None,
    as_json: AsJson = False,
) -> int:
    """Run the safety stories and measure them; exit code 1 if a limit is broken.

    Clients, plug, kill, race and soak run processes in real time, the others run in virtual time; the soak alone takes
    twenty minutes. All of them take hours: `--case` runs one, `--runs` shortens it.
    """
    silence_log()
    rows: list[Row] = []
    for name in (*_CASES, "soak") if case is None else (case,):
        rows.extend(run_soak(seconds) if name == "soak" else _CASES[name](runs, jobs))
    if page is not None:
        write_page(page, rows)
    if as_json:
        print(json.dumps({"rows": [asdict(row) for row in rows], "holds": all(row.holds for row in rows)}))
    else:
        _show(rows)
    return 0 if all(row.holds for row in rows) else 1


def _show(rows: list[Row]) -> None:
    table = Table("story", "boards", "runs", "figure", "limit", "holds")
    for row in rows:
        table.add_row(row.story, row.boards, str(row.runs), row.figure, row.limit, "yes" if row.holds else "NO")
    Console().print(table)

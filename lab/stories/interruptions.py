"""Rows of the stories in which boards or daemon begin anew: swaps, reboots, standstills, restarts in flight."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Final

from lab.rigs.cockpit import Boards
from lab.stories.cable import CLEARED, Cut, Cycle, pull_cable
from lab.stories.page import Row
from lab.stories.restarts import CLEARED as RESTART_CLEARED
from lab.stories.restarts import Restart, restart
from lab.stories.standstills import CLEARED as STOP_CLEARED
from lab.stories.standstills import Standstill, Stopped, stand_still
from lab.stories.swaps import LONGEST, Swapped, swap_aircraft
from mkdaemon.link.session.identity import GAP

RUNS: Final = 50
GENERATIONS: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"))
BEHIND: Final = (Boards("early", "0.24"), Boards("2.08", "0.24"), Boards("2.12a", "0.24"), Boards("2.14", "2.14"))
STOPS: Final = (1.0, 3.0, 10.0)
"""How long a daemon stands still [s]."""


def run_swaps(runs: int | None, jobs: int) -> Iterator[Row]:
    """Another aircraft at the same port; a run is there and back."""
    yield swap_row(swap_aircraft(1, count=2 * (runs or RUNS)))


def swap_row(found: list[Swapped]) -> Row:
    """The line of the swaps."""
    figure = (
        f"{sum(one.wrong for one in found)} frames of the wrong layout with the valid bit, "
        f"{sum(one.right for one in found)} of the right one; "
        f"{sum(one.found.startswith(one.expected) for one in found)} right discoveries"
    )
    wrong = [one for one in found if one.is_wrong]
    story = f"another aircraft at the same port, exchanged in {GAP:g} to {LONGEST:g} s"
    return Row("swap", story, "FC 2.12a and 2.08 behind NC 0.24", len(found), figure, f"0; -; {len(found)}",
               not wrong, {"wrong": [asdict(one) for one in wrong]})  # fmt: skip


def run_reboots(runs: int | None, jobs: int) -> Iterator[Row]:
    """The FlightCtrl reboots in flight, and keeps the first stick frame that it receives meanwhile."""
    for boards in GENERATIONS:
        yield reboot_row(boards.name, pull_cable(boards, 1, cycles=runs or RUNS, cuts=(Cut.REBOOT,)))


def reboot_row(boards: str, found: list[Cycle]) -> Row:
    """One line of reboots."""
    figure = (
        f"{sum(one.steered for one in found)} frames with the valid bit after; an old tilt obeyed in "
        f"{sum(one.obeyed > 0.0 for one in found)}, longest {max(one.obeyed for one in found):.2f} s; "
        f"{sum(one.is_held for one in found)} still held"
    )
    wrong = [one for one in found if one.is_wrong]
    return Row("reboot", "FlightCtrl reboots in flight", boards, len(found), figure, f"0; {CLEARED:g} s; 0", not wrong,
               {"wrong": [asdict(one) for one in wrong]})  # fmt: skip


def run_standstills(runs: int | None, jobs: int) -> Iterator[Row]:
    """The daemon stands still in flight."""
    for who in Stopped:
        for boards in GENERATIONS:
            for seconds in STOPS:
                found = stand_still(boards, who, seconds, seed=1, count=runs or RUNS)
                yield standstill_row(boards.name, f"{who} for {seconds:g} s", found)


def standstill_row(boards: str, who: str, found: list[Standstill]) -> Row:
    """One line of standstills."""
    cleared = [one.cleared for one in found if one.cleared is not None]
    figure = (
        f"{sum(one.tilted for one in found)} frames with the valid bit and a tilt after; external control cleared "
        f"{max(cleared, default=0.0):.3f} s after the end at the latest, never in {len(found) - len(cleared)}"
    )
    wrong = [one for one in found if one.is_wrong]
    return Row("freeze", f"frozen in flight: {who}", boards, len(found), figure, f"0; {STOP_CLEARED:g} s; 0", not wrong,
               {"wrong": [asdict(one) for one in wrong]})  # fmt: skip


def run_restarts(runs: int | None, jobs: int) -> Iterator[Row]:
    """The daemon starts anew in flight behind a NaviCtrl."""
    for boards in BEHIND:
        yield restart_row(boards.name, restart(boards, 1, count=runs or RUNS))


def restart_row(boards: str, found: list[Restart]) -> Row:
    """One line of restarts."""
    cleared = [one.cleared for one in found if one.cleared is not None]
    layouts = sorted({one.layout for one in found})
    figure = (
        f"control cleared within {max(cleared, default=0.0):.3f} s of the first bytes, never in "
        f"{len(found) - len(cleared)}; {sum(one.steered for one in found)} valid frames before the confirmation; "
        f"flown after it in {', '.join(layouts)}"
    )
    wrong = [one for one in found if one.is_wrong]
    return Row("restart", "daemon killed and started in flight", boards, len(found), figure,
               f"{RESTART_CLEARED:g} s; 0; 0; one layout", not wrong and len(layouts) == 1,
               {"wrong": [asdict(one) for one in wrong]})  # fmt: skip

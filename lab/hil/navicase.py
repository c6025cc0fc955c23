"""`python -m lab hil --case navictrl`: a genuine NaviCtrl and the simulator's, side by side; what differs, and why.

Four pieces of work, each in a process of its own: the script of bytes and the daemon's own code, on either board.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol

from lab.campaign import Row, in_order
from lab.hil.chip import Held
from lab.hil.naviaircraft import NaviAircraft
from lab.hil.navibuild import built_navictrl
from lab.hil.navicompare import differences
from lab.hil.navidaemon import DaemonAtNavi
from lab.hil.naviscript import FLIGHT, GROUND, LAST, Answers, Item, listen
from lab.hil.quiet import be_quiet
from lab.tables import show as show_rows
from mkdaemon.virtualtime import run_virtually
from mksim.boards.flightctrl import FlightCtrl
from mksim.config import GasLaw, PilotPlan, SimConfig
from mksim.physics.hand_flight import HandFlight
from mksim.programs.rehearsal import FlyingAircraft
from mksim.simulation import Simulation

BOOTED: Final = 8.0
"""Genuine boards need so long to start [s]; the simulator's wait as long."""
HOVERING: Final = 15.0
"""From the pilot's start to a steady hover [s]."""
STEP: Final = 0.01
KNOWN: Final[Mapping[str, str]] = {
    "nD.analog[4]": "the fork's own GPS code leaves the channel OperatingRadius alone",
    "text '\\n Timer2 deinit...": "the simulator's GPS receiver has no UART: nothing comes through to the host",
}
"""Beginnings of differences that are no fault, and why."""
CLOSE: Final = 0.06
"""Times of the daemon's steps may differ so much [s], or by a quarter: the boards' clocks are not in phase."""
STREAMS: Final = 0.07
"""One frame each of OSD data, debug data, attitude and display, at 57600 baud [s]. A version reply leaves after all of
them that are due (UART1_TransmitTxData of uart1.c), and whether they are depends on when the daemon subscribed last."""
BEHIND_STREAMS: Final = ("NaviCtrl after it",)
"""Steps that wait for such a reply while streams are being renewed."""
SCRIPT: Final = (*GROUND, *FLIGHT, *LAST)
"""Everything the host does."""


class Boards(FlyingAircraft, Protocol):
    """What both kinds of aircraft have."""

    @property
    def flight(self) -> FlightCtrl:
        """The simulated FlightCtrl."""


def show(seed: int, jobs: int, *, as_json: bool) -> int:
    """Compare, and show what differs; exit code 1 where something differs that is not known.

    Args:
        seed: of everything random.
        jobs: processes.
        as_json: print JSON, one object a line, in place of tables.

    Raises:
        ConfigError: no NaviCtrl is built.
    """
    release = built_navictrl().release
    work = [(kind, is_genuine, seed) for kind in ("bytes", "daemon") for is_genuine in (True, False)]
    genuine, simulated, steps, simulated_steps = in_order(_do, work, jobs, is_alone=True)
    shown: list[Row] = []
    for item, *pair in zip(SCRIPT, genuine, simulated, strict=True):
        found = list(differences(*pair))
        shown.append({"what": item.name, "differs": found, "holds": not unknown(found)})
    for one, other in zip(steps, simulated_steps, strict=False):
        times = {"genuine": [one["ended"], one["figure"]], "simulated": [other["ended"], other["figure"]]}
        shown.append({"what": one["what"], **times, "holds": agree(one, other)})
    shown.append({"what": "the daemon's steps", "holds": len(steps) == len(simulated_steps)})
    return show_rows(shown, ("what",), as_json=as_json, release=release)


def unknown(found: Sequence[str]) -> list[str]:
    """Differences that are not known."""
    return [words for words in found if not any(words.startswith(known) for known in KNOWN)]


def agree(genuine: Row, simulated: Row) -> bool:
    """Whether a step of the daemon ended alike, and took about as long."""
    (what, ended, one), other = (genuine[name] for name in ("what", "ended", "figure")), simulated["figure"]
    if (what, ended) != (simulated["what"], simulated["ended"]) or None in (one, other):
        return genuine == simulated
    close = STREAMS if what in BEHIND_STREAMS else CLOSE
    return bool(abs(one - other) <= max(close, 0.25 * abs(one)))


def _do(work: tuple[str, bool, int]) -> list[Any]:
    be_quiet()
    kind, is_genuine, seed = work
    config = SimConfig(seed=seed, pilot_plan=PilotPlan.NOTHING, fc="early", gas_law=GasLaw.FORK)

    def boards() -> Boards:
        return NaviAircraft(built_navictrl(), config) if is_genuine else Simulation(config)

    return _listen(boards()) if kind == "bytes" else run_virtually(_run_daemon(boards))


def _listen(boards: Boards) -> list[Answers]:
    """What the boards answer to the script."""

    def wait(seconds: float) -> None:
        until = boards.now + seconds
        while boards.now < until:
            boards.advance(boards.now + STEP)

    def listened(items: Sequence[Item]) -> list[Answers]:
        return [listen(boards, item, lambda: str(boards.flight.external.held)) for item in items]

    wait(BOOTED)
    found = listened(GROUND)
    boards.world.pilot.program = HandFlight()
    wait(HOVERING)
    return found + listened((*FLIGHT, *LAST))


async def _run_daemon(make: Callable[[], Boards]) -> list[Row]:
    boards = make()
    await asyncio.sleep(BOOTED)
    boards.advance(BOOTED)
    external = boards.flight.external

    def held() -> Held:
        now = external.held
        return now.pitch, now.roll, now.yaw, now.throttle, external.is_valid

    return await DaemonAtNavi(boards, held).run()

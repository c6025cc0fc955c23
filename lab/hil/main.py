"""`python -m lab hil`: the same scenes on simulated boards and on genuine firmware, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Final, Literal

from lab.campaign import Campaign, First, Jobs, Kept, Row
from lab.hil import endings, pair, rooms, scenes, triggers
from lab.hil.build import built, built_navictrl, names
from lab.hil.flights import SIMULATED, setting_of
from lab.hil.processes import be_quiet
from lab.hil.scenes import LINES
from mkdaemon.cli.arguments import AsJson
from mksim.config import WindClass

RUNS: Final = 10
"""Flights of each board by each line, and flights in which every trigger fires."""
FIRST_SEED: Final = 81_000_000
"""Of reported figures; what is tuned uses seeds below 10000."""
ALONE: Final = ("triggers", "pair")
"""Cases of genuine boards on a cable alone."""
LONGEST: Final = 1200.0
"""Processor time after which a flight has failed [s]."""


@dataclass(frozen=True, slots=True)
class Work:
    """One flight; see `main`."""

    case: str
    board: str
    line: str
    seed: int
    loss: float | None = None
    tilt: float = 0.0

    @property
    def key(self) -> Row:
        """Which flight it is."""
        more: Row = {"loss": self.loss, "tilt_deg": self.tilt} if self.case == "flights" else {}
        case = {"case": self.case} if self.case in rooms.GOALS else {}
        return case | {"board": self.board, "line": self.line, "seed": self.seed} | more


def fly(work: Work) -> Row:
    """Fly once."""
    be_quiet()
    setting = partial(setting_of, work.board, work.line, work.seed)
    match work.case:
        case "scenes":
            return scenes.fly(setting())
        case "flights":
            return endings.fly(setting(loss=work.loss, tilt_deg=work.tilt))
        case "triggers":
            return {"stories": triggers.fire(work.board, work.seed)}
        case "pair":
            return pair.fly(work.board, work.seed)
        case _:
            return rooms.fly(work.case, setting(fps=rooms.FPS, wind=WindClass.LIGHT))


def main(
    *,
    firmware: str = "",
    case: Literal["scenes", "flights", "room", "paths", "triggers", "pair"] = "scenes",
    line: Literal["both", "cable", "radio"] = "both",
    boards: Literal["both", "genuine", "simulated"] = "both",
    runs: int = RUNS,
    first: First = FIRST_SEED,
    loss: float | None = None,
    tilt: float = 0.0,
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Fly the scenes on genuine firmware and on the simulator's boards; exit code 1 if a goal is missed.

    In virtual time, exact whatever the machine does; a flight of all scenes takes about two minutes of one core. Build
    the firmware first: `make hil FIRMWARE=<folder> SIMAVR=<folder>`.

    Args:
        firmware: Name of one that was built; the first by default.
        case: The scenes; flights, and how each ended; from pad to pad through a room of
            surveyed tags, or figures of eight over them; what happens when something fails, judged by the firmware's
            memory; or flights behind a genuine NaviCtrl (`make hil NAVICTRL=<folder>`).
        line: To the boards.
        boards: Genuine, simulated, or both side by side.
        runs: Flights of each board by each line.
        loss: Of `flights`: share of the radio's packets that are lost, each way, for example 0.05.
        tilt: Of `flights`: of the pad, 0 to 20 degrees.
    """
    if case == "pair":
        built_navictrl()  # says what to build, before anything is flown
    genuine, seeds = built(firmware or next(iter(names()), "FlightCtrl")).name, range(first, first + runs)
    flown = {"both": (genuine, SIMULATED), "genuine": (genuine,), "simulated": (SIMULATED,)}[boards]
    lines = LINES if line == "both" else (line,)
    if case in ALONE:
        flown, lines = (genuine,), ("cable",)
    asked = [Work(case, board, by, seed, loss, tilt) for seed in seeds for board, by in product(flown, lines)]
    campaign = Campaign(f"hil {case}", fly, lambda work: work.key, limit=LONGEST, is_alone=case == "pair")
    shows = {"scenes": scenes.show, "flights": endings.show, "triggers": triggers.show, "pair": pair.show}
    return shows.get(case, rooms.show)(campaign.rows(asked, jobs, results), as_json=as_json)

"""`python -m lab hil --case flights`: many flights, how each ended, and what became of every frame.

Take-off, hold, a step of 1 m, light wind, landing; by cable or by the radio with a chosen loss, from a level or a
tilted pad. Physics and the firmware's memory judge: where the aircraft stands, whether its motors turn, and which
frames its receive buffer took.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lab import tables
from lab.campaign import Ending
from lab.hil.aircraft import GenuineAircraft
from lab.hil.figures import ON_TARGET, Array
from lab.hil.flights import Leg, SceneFlight, aircraft_of, config_of, motors_run
from lab.hil.scenes import setting_of
from lab.hil.tap import LINK_TEST, STICKS, Tap
from mkdaemon.virtualtime import run_virtually
from mksim.config import SimConfig, WindClass
from mksim.programs.rehearsal import FlightPart, land, over_pad, take_off
from mksim.scene.camera import DECK_RADIUS_M

PARTS: Final = (
    take_off(),
    over_pad("hold", 0.0, 8.0),
    over_pad("aside", -0.5),
    over_pad("step", 0.5, 4.0),
    over_pad("light", 0.0, 6.0, wind=WindClass.LIGHT),
    land(),
)
LIFTED: Final = 0.4
"""An aircraft whose centre of gravity was higher than this above the target has taken off [m]."""
COUNTS: Final = (
    "sticks_sent",
    "sticks_in_memory",
    "sticks_obeyed",
    "requests_sent",
    "requests_in_memory",
    "link_tests_sent",
    "link_tests_in_memory",
    "link_tests_answered",
)
ENDINGS: Final = (Ending.FINISHED, Ending.REFUSED, Ending.RELEASED, Ending.LOST, Ending.FAILED)
"""How a flight ends: it stands on the target with its motors off; it never left the ground; the daemon let go of it in
the air; everything else, a crash among it; or it could not be flown."""


@dataclass(frozen=True, slots=True)
class Work:
    """One flight.

    Attributes:
        board: name of a firmware, or `simulated`.
        line: `cable` or `radio`.
        seed: of everything random.
        loss: share of the radio's packets that are lost, each way; None for the radio's default.
        tilt_deg: of the pad [deg].
    """

    board: str
    line: str
    seed: int
    loss: float | None = None
    tilt_deg: float = 0.0


def fly(work: Work) -> dict[str, Any]:
    """Fly once in virtual time: how it ended, and what became of the frames."""
    return run_virtually(_fly(work))


async def _fly(work: Work) -> dict[str, Any]:
    setting = setting_of(work.board, work.line, work.seed)
    config = _config(config_of(setting), work)
    tap = Tap(aircraft_of(setting, config))
    flight = EndFlight(config, tap)
    await flight.fly()
    return flight.ending() | counts(tap)


def _config(config: SimConfig, work: Work) -> SimConfig:
    """The configuration with a pad at rest, tilted as asked, and with the loss."""
    raw = config.model_dump()
    height = DECK_RADIUS_M * math.tan(math.radians(work.tilt_deg))
    raw["scene"]["platform"] = {"start_enu": (0.0, 0.0, height), "tilt_deg": work.tilt_deg}
    if work.loss is not None:
        for way in raw["radio"].values():
            way["loss"] = work.loss
    return SimConfig.model_validate(raw)


class EndFlight(SceneFlight):
    """Flies `PARTS`; its tap counts from the take-off on.

    Attributes:
        let_go_at: when the daemon had ended the flight [s]; infinite before.
    """

    def __init__(self, config: SimConfig, tap: Tap) -> None:
        """Set everything up; needs a running loop."""
        super().__init__(config, tap, (Leg(PARTS),))
        self._tap, self._aircraft = tap, tap.aircraft
        self.let_go_at = math.inf

    async def _follow(self, parts: Sequence[FlightPart]) -> bool:
        self._tap.is_counting = True
        goes_on = await super()._follow(parts)
        self._tap.is_counting = False
        self.let_go_at = self._loop.time()
        return goes_on

    def ending(self) -> dict[str, Any]:
        """How it ended and why, by the physics and the board's motors; the daemon's reason is only told."""
        truth = np.array(self.flown.truth).reshape(-1, 6)
        found = {"why": self.flown.end, "warnings": self.found["warnings"]}
        return found | judged(truth, self.let_go_at, self.flown.crashed, motors_run=motors_run(self._aircraft))


def judged(truth: Array, let_go_at: float, crashed: str, *, motors_run: bool) -> dict[str, Any]:
    """How a flight ended; see `ENDINGS`.

    Args:
        truth: see `Flown.truth`.
        let_go_at: when the daemon had ended the flight [s].
        crashed: why the aircraft broke; empty while whole.
        motors_run: whether the board turns the motors at the end.
    """
    if crashed:
        return {"ending": Ending.LOST, "why": crashed}
    if not len(truth) or truth[:, 3].max() < LIFTED:
        return {"ending": Ending.REFUSED}
    row = truth[truth[:, 0] <= let_go_at][-1]
    if not row[5]:
        return {"ending": Ending.RELEASED}
    off = float(np.hypot(row[1], row[2]))
    if off > ON_TARGET or motors_run:
        return {
            "ending": Ending.LOST,
            "why": f"{100 * off:.0f} cm from the middle, motors {'on' if motors_run else 'off'}",
        }
    return {"ending": Ending.FINISHED, "off_cm": 100 * off}


def counts(tap: Tap) -> dict[str, Any]:
    """What became of the frames; of simulated boards nothing is known from a memory."""
    is_genuine = isinstance(tap.aircraft, GenuineAircraft)
    sent, taken, heard = tap.sent, tap.taken, tap.heard
    found: dict[str, Any] = {
        "sticks_sent": sent[STICKS],
        "requests_sent": sent.total() - sent[STICKS],
        "link_tests_sent": sent[LINK_TEST],
        "link_tests_answered": heard[LINK_TEST.upper()],
    }
    if is_genuine:
        found |= {
            "sticks_in_memory": taken[STICKS],
            "sticks_obeyed": tap.obeyed,
            "requests_in_memory": taken.total() - taken[STICKS],
            "link_tests_in_memory": taken[LINK_TEST],
            "buffer_held_ms": [1000 * float(part) for part in np.percentile(tap.waits or [math.nan], (50, 99, 100))],
        }
    return found


def summed(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How many flights ended how, why those that did not finish, and the sum of the counts."""
    found: dict[str, Any] = {ending.value: sum(row["ending"] == ending for row in rows) for ending in ENDINGS}
    found["why"] = [f"{row['seed']} {row['ending']}: {row['why']}" for row in rows if row["ending"] != Ending.FINISHED]
    found["warnings"] = dict(Counter(text for row in rows for text in row.get("warnings", ())).most_common(5))
    for name in COUNTS:
        values = [row[name] for row in rows if name in row]
        if values:
            found[name] = sum(values)
    return found


def show(rows: Sequence[Mapping[str, Any]], *, as_json: bool) -> int:
    """Print a summary of every board and line; exit code 1 unless every flight finished or was refused."""
    shown = []
    for board, line in dict.fromkeys((row["board"], row["line"]) for row in rows):
        part = summed([row for row in rows if (row["board"], row["line"]) == (board, line)])
        holds = not any(part[ending] for ending in (Ending.RELEASED, Ending.LOST, Ending.FAILED))
        shown.append({"board": board, "line": line} | part | {"holds": holds})
    return tables.show(shown, ("board", "line"), as_json=as_json)

"""`python -m lab hil --case flights`: many flights, and how each ended.

Take-off, hold, a step of 1 m, light wind, landing; by cable or by the radio with a chosen loss, from a level or a
tilted pad. Physics and the board's motors judge.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from lab import tables
from lab.campaign import Ending, Row, summed_up
from lab.demo import STRAYED, flown
from lab.hil.flights import Setting, aircraft_of, config_of, motors_run
from lab.vision.lens import drawn_lens
from mksim.config import WindClass
from mksim.programs.rehearsal import Rehearsal, land, over_pad, take_off

PARTS: Final = (
    take_off(),
    over_pad("hold", 0.0, 8.0),
    over_pad("aside", -0.5),
    over_pad("step", 0.5, 4.0),
    over_pad("light", 0.0, 6.0, wind=WindClass.LIGHT),
    land(),
)


def fly(setting: Setting) -> Row:
    """Fly once in virtual time, with a calibration that is wrong as its floor says; see `lab.demo.landing_of`."""
    config, rng = config_of(setting), np.random.default_rng(setting.seed)
    aircraft = aircraft_of(setting, config)
    _, row = flown(
        lambda watch: Rehearsal(config, aircraft, watch, PARTS, calibrated=lambda lens: drawn_lens(lens, rng)), STRAYED
    )
    if row["ending"] == Ending.FINISHED and motors_run(aircraft):
        row |= {"ending": Ending.LOST, "why": "its motors run on the ground"}
    return row


def show(rows: Sequence[Row], *, as_json: bool) -> int:
    """Print how the flights of every board and line ended; exit code 1 unless all finished."""
    shown = []
    for board, line in dict.fromkeys((row["board"], row["line"]) for row in rows):
        part = [row for row in rows if (row["board"], row["line"]) == (board, line)]
        shown.append({"board": board, "line": line, **summed_up(part, "touch_cm")})
    return tables.show(shown, ("board", "line"), as_json=as_json)

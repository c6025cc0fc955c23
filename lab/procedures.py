"""`python -m lab procedures`: uploads and backups over a line that loses and damages bytes, in virtual time.

Each run ends verified or in a named failure, and what it claims is compared with what the simulated board really holds.
Everything is drawn from the run's seed, so a run that fails can be looked at again.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from lab.campaign import Row
from lab.cases import Case, Figure, Flight, command, judged, total
from lab.rigs.grounded import GroundedAircraft
from lab.rigs.virtualline import Noise, VirtualBoard, VirtualLine
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.protocol.generations import Release
from mkdaemon.protocol.procedures.points import point_format, to_points
from mkdaemon.protocol.procedures.settings_slots import backup_settings
from mkdaemon.protocol.procedures.steps import Patience, Procedure
from mkdaemon.protocol.procedures.waypoint_list import upload_points
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.mission import Mission, MissionPoint
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.boards.navictrl import NaviCtrl

NOISE: Final = Noise(lost=0.015, damaged=0.015, stalled=0.01, longest_stall=1.0, repeated=0.01)
"""Three of a hundred bytes come to harm, half of them lost, half damaged; some frames are late or come twice."""
POOR: Final = Noise(lost=0.005, damaged=0.005, stalled=0.01, longest_stall=1.0, repeated=0.01)
"""A third of it: with little patience most backups break off in the middle, with another set loaded."""
UPLOAD_PATIENCE: Final = Patience(attempts=60, timeout=0.1)
BACKUP_PATIENCE: Final = Patience(attempts=5000, timeout=0.1)
"""A parameter set is 202 characters: at three harmed bytes of a hundred one reply in 640 arrives whole."""
HASTY: Final = Patience(attempts=12, timeout=0.1)


LIMITS: Final = {"claims_wrongly": False, "is_changed": False}
"""Of a run: it neither lies nor leaves another live set."""


def random_route(rng: random.Random, count: int) -> tuple[WireMessage, ...]:
    """Points as NaviCtrl 0.24 takes them, every field drawn."""
    points = (
        MissionPoint(
            latitude_deg=rng.uniform(-90, 90),
            longitude_deg=rng.uniform(-180, 180),
            altitude=rng.uniform(0, 200),
            radius=rng.randrange(256),
            hold=rng.randrange(256),
            heading_deg=rng.randrange(1, 361),
            climb=rng.randrange(256) / 10,
            event=rng.randrange(256),
        )
        for _ in range(count)
    )
    return to_points(Mission(points=tuple(points)), point_format(Release(0, 24)))


def run_upload(seed: int, noise: Noise = NOISE, patience: Patience = UPLOAD_PATIENCE, *, longest: int = 31) -> Row:
    """Upload a random mission over an old one, and compare the claim with the board's list; see `_row`."""
    rng = random.Random(seed)
    flight = FlightCtrl(FC_GENERATIONS["2.12a"], GroundedAircraft(), seed=seed)
    board = NaviCtrl(NC_GENERATIONS["0.24"], flight, seed=seed)
    for old in random_route(rng, rng.randint(0, longest)):
        board.navigator.points.write(old.encode())
    points = random_route(rng, rng.randint(1, longest))
    end, line = _drive(board, noise, rng, upload_points(points, patience))
    held = [(board.navigator.points.read(number) or b"")[2:] for number in range(1, board.navigator.points.count + 1)]
    lies = end == "verified" and held != [point.encode() for point in points]
    return _row(end, line, claims_wrongly=lies, is_changed=False)


def run_backup(seed: int, noise: Noise = NOISE, patience: Patience = BACKUP_PATIENCE) -> Row:
    """Back up five different sets; compare the files with the EEPROM, the live set with what it was; see `_row`."""
    rng = random.Random(seed)
    board = FlightCtrl(FC_GENERATIONS["2.12a"], GroundedAircraft(), seed=seed)
    for slot, raw in list(board.eeprom.sets.items()):
        board.eeprom.sets[slot] = raw[:50] + bytes((slot, *rng.randbytes(20))) + raw[71:]
    board.eeprom.active = rng.randint(1, 5)
    board.load(board.eeprom.active)
    live, sets = board.live.raw, dict(board.eeprom.sets)
    saved: dict[int, bytes] = {}

    def procedure() -> Procedure[None]:
        backup = yield from backup_settings(patience)
        saved.update(backup.sets)

    end, line = _drive(board, noise, rng, procedure())
    lies = end == "verified" and {slot: raw[: len(live)] for slot, raw in saved.items()} != sets
    return _row(end, line, claims_wrongly=lies, is_changed=board.live.raw != live)


def _row(end: str, line: VirtualLine, **found: bool) -> Row:
    """How one run ended.

    Args:
        end: `verified`, or the name of the failure.
        line: how many requests were sent on it.
        found: it claimed what the board does not hold; the live parameter set is not what it was (backups).
    """
    return judged(LIMITS, end=end, asked=line.asked, **found)


def _drive(
    board: VirtualBoard, noise: Noise, rng: random.Random, procedure: Procedure[object]
) -> tuple[str, VirtualLine]:
    line = VirtualLine(board, noise, rng)
    try:
        line.run(procedure)
    except CommandRejectedError as error:
        return error.token, line
    except MkError as error:
        return type(error).__name__, line
    return "verified", line


def _flights(rows: Mapping[str, Callable[[int], Row]], runs: int) -> Callable[[int | None, int], list[Flight]]:
    return lambda asked, first: [
        Flight(what, "virtual line", run, seed)
        for what, run in rows.items()
        for seed in range(first, first + (asked or runs))
    ]


FIGURES: Final[Mapping[str, Figure]] = {
    "ends": lambda found: dict(Counter(one["end"] for one in found).most_common()),
    "claims_wrongly": total("claims_wrongly"),
    "live_set_changed": total("is_changed"),
}
BACKUPS: Final[Mapping[str, Callable[[int], Row]]] = {
    "backups, 1 % of bytes harmed, 12 attempts": partial(run_backup, noise=POOR, patience=HASTY),
    "backups, 3 % of bytes harmed, 5000 attempts": run_backup,
}
CASES: Final = {
    "uploads": Case(_flights({"uploads, 3 % of bytes harmed": run_upload}, 1000), FIGURES),
    "backups": Case(_flights(BACKUPS, 200), FIGURES),
}

main: Final = command(
    "procedures",
    CASES,
    """Upload missions and back up settings over a bad line; exit code 1 if any run lied or left another live set.

    Virtual time, seeded. The backups over the worst line take nearly all of it; `--runs 2` is a quick look.
    """,
    first=0,
)

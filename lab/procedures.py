"""`python -m lab procedures`: uploads and backups over a line that loses and damages bytes, in virtual time.

Each run ends verified or in a named failure, and what it claims is compared with what the simulated board really holds.
Everything is drawn from the run's seed, so a run that fails can be looked at again.
"""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Annotated, Final, NamedTuple

from cyclopts import Parameter

from lab.campaign import in_order
from lab.rigs.grounded import GroundedAircraft
from lab.rigs.virtualline import Noise, VirtualBoard, VirtualLine
from mkdaemon.cli.arguments import AsJson
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
FAIR: Final = Noise(lost=0.0015, damaged=0.0015, stalled=0.01, longest_stall=1.0, repeated=0.01)
"""A tenth of that: a line somebody might still use."""
POOR: Final = Noise(lost=0.005, damaged=0.005, stalled=0.01, longest_stall=1.0, repeated=0.01)
"""A third of it: with little patience most backups break off in the middle, with another set loaded."""
UPLOAD_PATIENCE: Final = Patience(attempts=60, timeout=0.1)
BACKUP_PATIENCE: Final = Patience(attempts=5000, timeout=0.1)
"""A parameter set is 202 characters: at three harmed bytes of a hundred one reply in 640 arrives whole."""
SHORT_PATIENCE: Final = Patience(attempts=40, timeout=0.1)
HASTY: Final = Patience(attempts=12, timeout=0.1)


class Run(NamedTuple):
    """How one run ended.

    Attributes:
        seed: of everything random in it.
        end: `verified`, or the name of the failure.
        is_wrong: it claimed what the board does not hold.
        is_changed: the live parameter set is not what it was (backups).
        asked: requests sent.
        seconds: virtual time it took [s].
    """

    seed: int
    end: str
    is_wrong: bool
    is_changed: bool
    asked: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Tally:
    """A campaign.

    Attributes:
        name: what was done, over what line.
        runs: how many.
        ends: how many ended how.
        wrong: seeds that claimed what the board does not hold.
        changed: seeds after which the live set was another.
        asked: requests sent in all.
        virtual_hours: time it would have taken [h].
    """

    name: str
    runs: int
    ends: dict[str, int]
    wrong: list[int]
    changed: list[int]
    asked: int
    virtual_hours: float


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


def run_upload(seed: int, noise: Noise = NOISE, patience: Patience = UPLOAD_PATIENCE, *, longest: int = 31) -> Run:
    """Upload a random mission over an old one, and compare the claim with the board's list."""
    rng = random.Random(seed)
    flight = FlightCtrl(FC_GENERATIONS["2.12a"], GroundedAircraft(), seed=seed)
    board = NaviCtrl(NC_GENERATIONS["0.24"], flight, seed=seed)
    for old in random_route(rng, rng.randint(0, longest)):
        board.navigator.points.write(old.encode())
    points = random_route(rng, rng.randint(1, longest))
    end, line = _drive(board, noise, rng, upload_points(points, patience))
    held = [(board.navigator.points.read(number) or b"")[2:] for number in range(1, board.navigator.points.count + 1)]
    is_wrong = end == "verified" and held != [point.encode() for point in points]
    return Run(seed, end, is_wrong, False, line.traffic.asked, line.now)


def run_backup(seed: int, noise: Noise = NOISE, patience: Patience = BACKUP_PATIENCE) -> Run:
    """Back up five different sets, and compare the files with the EEPROM and the live set with what it was."""
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
    is_wrong = end == "verified" and {slot: raw[: len(live)] for slot, raw in saved.items()} != sets
    return Run(seed, end, is_wrong, board.live.raw != live, line.traffic.asked, line.now)


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


def campaign(name: str, run: Callable[[int], Run], runs: int, jobs: int) -> Tally:
    """Do the runs of seeds 0, 1, 2... and count."""
    found = in_order(run, range(runs), jobs)
    return Tally(
        name=name,
        runs=runs,
        ends=dict(Counter(one.end for one in found).most_common()),
        wrong=[one.seed for one in found if one.is_wrong],
        changed=[one.seed for one in found if one.is_changed],
        asked=sum(one.asked for one in found),
        virtual_hours=round(sum(one.seconds for one in found) / 3600, 2),
    )


def run_fair_backup(seed: int) -> Run:
    """One backup over the fair line."""
    return run_backup(seed, FAIR, SHORT_PATIENCE)


def run_hasty_backup(seed: int) -> Run:
    """One backup over the poor line that mostly breaks off in the middle."""
    return run_backup(seed, POOR, HASTY)


def run_impatient_backup(seed: int) -> Run:
    """One backup over the bad line that gives up early."""
    return run_backup(seed, NOISE, SHORT_PATIENCE)


def main(
    *,
    uploads: int = 1000,
    backups: int = 200,
    jobs: Annotated[int, Parameter(help="Processes.")] = 1,
    as_json: AsJson = False,
) -> int:
    """Upload missions and back up settings over a bad line; exit code 1 if any run lied or left another live set.

    Virtual time, seeded. The backups over the worst line take nearly all of it; `--uploads 10 --backups 2` is
    a quick look.
    """
    tallies = [
        campaign("uploads, 3 % of bytes harmed", run_upload, uploads, jobs),
        campaign("backups, 0.3 % of bytes harmed", run_fair_backup, backups, jobs),
        campaign("backups, 1 % of bytes harmed, 12 attempts", run_hasty_backup, backups, jobs),
        campaign("backups, 3 % of bytes harmed, 40 attempts", run_impatient_backup, backups, jobs),
        campaign("backups, 3 % of bytes harmed, 5000 attempts", run_backup, backups, jobs),
    ]
    if as_json:
        print(json.dumps({"campaigns": [asdict(tally) for tally in tallies]}))
    else:
        for tally in tallies:
            ends = ", ".join(f"{count} {end}" for end, count in tally.ends.items())
            print(
                f"{tally.name}: {tally.runs} runs: {ends}; wrong claims {tally.wrong}, live set changed {tally.changed}"
            )
            print(f"  {tally.asked} requests, {tally.virtual_hours} h on a real line")
    return 1 if any(tally.wrong or tally.changed for tally in tallies) else 0

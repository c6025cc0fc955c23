"""`python -m lab link`: losses and delays of the link under load, in virtual time: the same on every machine.

By radio, where losses of short runs scatter, every conversation is followed through the packets that carried it:
`proof` says who lost it, and how much of the loss can be ours at most.
"""

from __future__ import annotations

import asyncio
import sys
from bisect import bisect_left
from collections.abc import Sequence
from typing import Annotated, Final

from cyclopts import Parameter

from lab.campaign import Row
from lab.link.cases import CASES, Case, configurations, running_link, steer_steadily
from lab.link.fates import Tracer, echo_account, stick_account
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError
from mkdaemon.link.session.evidence import percentile
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.telemetry.link import RoundTripStats
from mkdaemon.virtualtime import run_virtually

ANSWERED: Final = 0.95
"""Share of link tests that are answered in flight."""
TAIL: Final = 0.4
"""Until what was under way has arrived [s]; the slowest way there and back takes 0.13 s."""
PROOF: Final = 600.0
"""Length of a proof [s]: 6000 link tests; none of ours lost among them bounds our share to 0.05 %."""
LIMIT: Final = 0.002
"""Largest share of conversations that may be lost beyond what the radio takes."""


async def play(case: Case, seconds: float) -> Row:
    """Play one case for a time [s]; needs a loop in virtual time. Its figures, and who lost what: `proof`."""
    sim, options = configurations(case)
    tracer, loop = Tracer(sim), asyncio.get_running_loop()
    async with running_link(case, tracer, options) as running:
        before, began = running.link.health(), loop.time()
        handed_in = await steer_steadily(running.link, case, seconds)
        ended = loop.time()
        await asyncio.sleep(TAIL)
        after = running.link.health()
    echoes, sticks = ([fate for fate in all_of if began <= fate.asked] for all_of in (tracer.echoes, tracer.sticks))
    left = [frame.at for frame in running.log.tx if frame.purpose is Purpose.SETPOINT]
    waits = _waits(handed_in, left)
    proof = {"echo": echo_account([fate for fate in echoes if fate.asked < ended])}
    if handed_in:
        proof["control"] = stick_account([fate for fate in sticks if fate.asked < ended], len(handed_in))
    return {
        "case": case.name,
        "echo_loss": _loss(before.echo, after.echo),
        "control_loss": _loss(before.confirm, after.confirm),
        "control_undelivered": _share(sum(fate.arrived is None for fate in sticks), len(sticks)),
        "confirms_replaced": after.stick_frames.replaced - before.stick_frames.replaced,
        "setpoint_wait_p50_ms": _ms(percentile(waits, 0.50)),
        "setpoint_wait_p99_ms": _ms(percentile(waits, 0.99)),
        "setpoints_replaced": _share(len(handed_in) - len(left), len(handed_in)),
        "radio_loss": tracer.radio_loss(),
        "proof": proof,
    }


def _waits(handed_in: Sequence[float], left: Sequence[float]) -> list[float]:
    """Time until each setpoint, or a newer one that replaced it, had left [s], ascending."""
    places = ((at, bisect_left(left, at)) for at in handed_in)
    return sorted(left[place] - at for at, place in places if place < len(left))


def _loss(before: RoundTripStats, after: RoundTripStats) -> float | None:
    """Share lost of what was sent between two measurements."""
    return _share(after.lost_total - before.lost_total, after.sent_total - before.sent_total)


def _share(some: int, every: int) -> float | None:
    return round(some / every, 5) if every else None


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000 * seconds, 3)


def main(
    *,
    case: Annotated[str | None, Parameter(help="One experiment; all of them by default.")] = None,
    seconds: Annotated[float | None, Parameter(help="Length of each experiment [s].")] = None,
    proof: Annotated[float, Parameter(help="Length of the proof by radio [s]; 0 for none.")] = PROOF,
    as_json: AsJson = False,
) -> int:
    """Measure the link; exit code 1 when a wired case lost a frame, or one by radio more than the radio and 0.2 %.

    Five minutes, nearly all of it for the proofs by radio; `--case light` is the shortest.

    Raises:
        ConfigError: no such case.
    """
    if case is not None and case not in CASES:
        raise ConfigError(f"no case {case!r}: choose from {', '.join(CASES)}")
    rows = []
    for chosen in [CASES[case]] if case else CASES.values():
        row = run_virtually(play(chosen, seconds or chosen.seconds))
        del row["proof"]
        if proof and chosen.is_by_radio and not chosen.is_flown:
            row["proof"] = run_virtually(play(chosen, proof))["proof"]
        rows.append(row | {"holds": holds(row)})
        print(f"{chosen.name}: {'holds' if rows[-1]['holds'] else 'WRONG'}", file=sys.stderr, flush=True)
    return show(rows, ("case",), as_json=as_json)


def holds(row: Row) -> bool:
    """Whether the line and we lost nothing by cable, and by radio no more than proven to be the radio's and `LIMIT`.

    A FlightCtrl that flies has no time for some frames: there `ANSWERED` of the link tests have to be answered, those
    that the radio took left out.
    """
    case = CASES[row["case"]]
    if case.is_flown:
        return bool(1.0 - row["echo_loss"] >= ANSWERED * (1.0 - row["radio_loss"]))
    if case.is_by_radio:
        return all(account["by_us_at_most"] <= LIMIT for account in row.get("proof", {}).values())
    return not (row["echo_loss"] or row["control_undelivered"])

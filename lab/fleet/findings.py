"""What a cut of one aircraft's link must show: the limits that it is held to. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

from mkdaemon.reading.known import SIGN_OF_LIFE

TOLD: Final = 1.0
"""The fleet view says `stale` so long after its own limit at the latest [s]."""
GONE: Final = 4.0
"""A daemon that is cut off has gone from the router's list after so long [s]: its bus lease of 2 s, and the machine."""
REFUSED: Final = 4.0
"""Longest wait of a program that asks an aircraft that is cut off [s]."""
RELEASED: Final = (0.9, 2.0)
"""From the last setpoint that came through to the release on the wire [s]: 1.0 s by docs/safety.md."""
HEALED: Final = 10.0
"""Longest time from the link's return to fresh telemetry [s]."""
UNTOUCHED: Final = 2.0
"""Longest time without a value of the others [s]: `health` comes every second."""
ABOARD: Final = 1.5
"""The same of the black box aboard, through the cut [s]."""
NOT_CUT: Final = 0.5
"""A recording on the ground has a gap of the cut's length, less so much [s]."""


def claims(found: Mapping[str, Any]) -> dict[str, bool]:
    """What must be so after a cut, in words, and whether it is.

    Args:
        found: times from the cut, or from the link's return [s], None for never: `told_stale`, `told_gone` and
            `told_back` by the fleet view, `fresh` telemetry, `leased_again`, `client_told` that its lease is lost,
            `last_setpoint` that reached the aircraft, and `released`, on its wire, from that setpoint on. `others`,
            what the view said of them, `others_gap`, longest time without a value of theirs [s], `others_lost`, values.
            `refusals`, rows of what was asked while it was cut off. `aboard`, values in the black box in the cut, and
            `aboard_gap`; `ground_gap` of the same key on the ground, and `ground_lost`. `cut_for` [s]; `exit_codes` of
            the daemons.
    """
    least, most = RELEASED
    untouched = (found["others"], found["others_lost"]) == (["here"], 0) and found["others_gap"] <= UNTOUCHED
    is_gone = _within(found["told_gone"], GONE)
    return {
        "the fleet view says stale": _within(found["told_stale"], SIGN_OF_LIFE + TOLD) or is_gone,
        "the fleet view says gone": is_gone,
        "the others are untouched": untouched,
        "commands refuse clearly": bool(found["refusals"]) and all(map(is_clear, found["refusals"])),
        "the daemon releases": found["released"] is not None and least <= found["released"] <= most,
        "its client is told": found["client_told"] is not None,
        "telemetry heals": _within(found["fresh"], HEALED) and _within(found["told_back"], HEALED),
        "the lease can be taken again": found["leased_again"] is not None,
        "the black box has the gap": found["aboard"] > 0 and found["aboard_gap"] <= ABOARD,
        "the ground's recording names it": found["ground_gap"] >= found["cut_for"] - NOT_CUT
        and found["ground_lost"] > 0,
        "daemons end in order": bool(found["exit_codes"]) and not any(found["exit_codes"]),
    }


def is_clear(refusal: Mapping[str, Any]) -> bool:
    """Whether what was `asked` ended in time, with one line that names the aircraft and what to look at.

    Args:
        refusal: `took` until it ended [s], the `words` of it, `is_refused`, `is_program`: with its start, which is the
            machine's.
    """
    has_words = "does not reach vehicle" in refusal["words"] and "\n" not in refusal["words"].strip()
    return refusal["is_refused"] and has_words and (refusal["is_program"] or refusal["took"] <= REFUSED)


def _within(time: float | None, limit: float) -> bool:
    return time is not None and time <= limit


def longest_gap(times: Sequence[float], begin: float, end: float) -> float:
    """Longest time without a value from a begin to an end [s]; values before and behind count as the edges' own."""
    inside = [begin, *(at for at in times if begin < at < end), end]
    return max(later - sooner for sooner, later in pairwise(inside))

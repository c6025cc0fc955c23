"""What a cut of one aircraft's link showed, and the limits that it is held to. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
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


@dataclass
class Refusal:
    """How a request to an aircraft that is cut off ended.

    Attributes:
        asked: what was asked.
        after: so long after the cut [s].
        took: until it ended [s]; of a program with its start, which is the machine's.
        words: what it said.
        is_refused: it did not succeed.
        is_program: a process of its own was asked.
    """

    asked: str
    after: float
    took: float
    words: str
    is_refused: bool
    is_program: bool = False

    @property
    def holds(self) -> bool:
        """It ended in time, with one line that names the aircraft and what to look at."""
        has_words = "does not reach vehicle" in self.words and "\n" not in self.words.strip()
        return self.is_refused and has_words and (self.is_program or self.took <= REFUSED)


@dataclass
class CutFindings:
    """What a cut showed; times from the cut, or from the link's return [s]; None for never.

    Attributes:
        cut_for: length of the cut.
        loss: share of packets lost on that link, each way, all the time.
        delay: on that link, each way [s].
        told_stale: the fleet view calls the aircraft stale.
        told_gone: it calls it gone.
        told_back: it calls it here again; from the link's return.
        fresh: telemetry has come through again; from the link's return.
        leased_again: the lease was granted again; from the link's return.
        others: what the fleet view said of the others meanwhile.
        others_gap: longest time without a value of theirs on the ground, from the cut to the link's return.
        others_lost: values of theirs that the recorder on the ground knows it has missed.
        refusals: requests while it was cut off.
        last_setpoint: the last one that reached the aircraft; from the cut.
        released: the release on its wire; from that setpoint.
        reason: of that release, as the black box has it.
        client_told: the client that flew it lost its lease; from the cut.
        client_words: what it was told.
        aboard_gap: longest gap in the black box from the cut to the link's return.
        aboard: values in the black box in that time.
        ground_gap: longest gap of the same key on the ground.
        ground_lost: values that the ground recorder knows it has missed.
        exit_codes: of the daemons.
    """

    cut_for: float
    loss: float
    delay: float
    told_stale: float | None = None
    told_gone: float | None = None
    told_back: float | None = None
    fresh: float | None = None
    leased_again: float | None = None
    others: set[str] = field(default_factory=set)
    others_gap: float = 0.0
    others_lost: int = 0
    refusals: list[Refusal] = field(default_factory=list)
    last_setpoint: float | None = None
    released: float | None = None
    reason: str = ""
    client_told: float | None = None
    client_words: str = ""
    aboard_gap: float = 0.0
    aboard: int = 0
    ground_gap: float = 0.0
    ground_lost: int = 0
    exit_codes: list[int] = field(default_factory=list)

    def claims(self) -> dict[str, bool]:
        """What must be so, in words, and whether it is."""
        return {
            "the fleet view says stale": _within(self.told_stale, SIGN_OF_LIFE + TOLD) or _within(self.told_gone, GONE),
            "the fleet view says gone": _within(self.told_gone, GONE),
            "the others are untouched": self._others_are_untouched,
            "commands refuse clearly": bool(self.refusals) and all(refusal.holds for refusal in self.refusals),
            "the daemon releases": self.released is not None and RELEASED[0] <= self.released <= RELEASED[1],
            "its client is told": self.client_told is not None,
            "telemetry heals": _within(self.fresh, HEALED) and _within(self.told_back, HEALED),
            "the lease can be taken again": self.leased_again is not None,
            "the black box has the gap": self.aboard > 0 and self.aboard_gap <= ABOARD,
            "the ground's recording names it": self.ground_gap >= self.cut_for - NOT_CUT and self.ground_lost > 0,
            "daemons end in order": bool(self.exit_codes) and not any(self.exit_codes),
        }

    @property
    def _others_are_untouched(self) -> bool:
        return self.others == {"here"} and self.others_gap <= UNTOUCHED and not self.others_lost

    @property
    def holds(self) -> bool:
        """Whether all of it is so."""
        return all(self.claims().values())

    def row(self) -> dict[str, Any]:
        """All of it as JSON has it."""
        found = vars(self) | {"others": sorted(self.others), "refusals": [vars(one) for one in self.refusals]}
        return found | {"claims": self.claims(), "holds": self.holds}


def _within(time: float | None, limit: float) -> bool:
    return time is not None and time <= limit


def longest_gap(times: Sequence[float], begin: float, end: float) -> float:
    """Longest time without a value from a begin to an end [s]; values before and behind count as the edges' own."""
    inside = [begin, *(at for at in times if begin < at < end), end]
    return max(later - sooner for sooner, later in pairwise(inside))

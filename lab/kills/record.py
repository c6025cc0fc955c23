"""One kill, what was there before it, and what is left; counts of many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

RESTORED: Final = (1, 4)
"""Sets that a restore changes; the active one is another."""


@dataclass(frozen=True, slots=True)
class Kill:
    """One kill and what was left.

    Attributes:
        victim: `mkctl` or `daemon`.
        verb: `backup` or `restore`.
        seed: of everything random in it.
        moment: from the first progress to the kill [s].
        was_other_set_live: another set than the right one was live at that moment.
        is_live_same: the live set is byte-identical in the end, and the same one is active.
        are_others_same: so is every stored set that was not to be changed.
        is_half_written: a set to be restored is neither the old one nor the new one.
        took: from the kill to the end of the procedure, or to the proof after the next start [s].
    """

    victim: str
    verb: str
    seed: int
    moment: float
    was_other_set_live: bool
    is_live_same: bool
    are_others_same: bool
    is_half_written: bool
    took: float

    @property
    def is_wrong(self) -> bool:
        """Whether anything is not as it must be."""
        return not (self.is_live_same and self.are_others_same) or self.is_half_written


class Contents(NamedTuple):
    """What a FlightCtrl holds.

    Attributes:
        live: bytes of the live set.
        active: number of the active set.
        sets: bytes of the stored sets.
    """

    live: bytes
    active: int
    sets: dict[int, bytes]


@dataclass(frozen=True, slots=True)
class Cut:
    """A procedure that was cut off.

    Attributes:
        victim: `mkctl` or `daemon`.
        verb: `backup` or `restore`.
        seed: of everything random in it.
        moment: from the first progress to the kill [s].
        before: what the FlightCtrl held before it.
        wanted: what a restore was to write.
        was_other_set_live: at the moment of the kill.
    """

    victim: str
    verb: str
    seed: int
    moment: float
    before: Contents
    wanted: dict[int, bytes]
    was_other_set_live: bool

    def judge(self, after: Contents, took: float) -> Kill:
        """Compare what is left with what was there."""
        changed = RESTORED if self.verb == "restore" else ()
        before = self.before.sets
        return Kill(
            victim=self.victim,
            verb=self.verb,
            seed=self.seed,
            moment=round(self.moment, 3),
            was_other_set_live=self.was_other_set_live,
            is_live_same=(after.live, after.active) == (self.before.live, self.before.active),
            are_others_same=all(after.sets[slot] == raw for slot, raw in before.items() if slot not in changed),
            is_half_written=any(after.sets[slot] not in (before[slot], self.wanted[slot]) for slot in changed),
            took=round(took, 3),
        )


def summarise(kills: list[Kill]) -> list[dict[str, object]]:
    """Counts by victim and procedure."""
    rows = []
    for victim, verb in dict.fromkeys((kill.victim, kill.verb) for kill in kills):
        these = [kill for kill in kills if (kill.victim, kill.verb) == (victim, verb)]
        times = sorted(kill.took for kill in these)
        row = {
            "victim": victim,
            "verb": verb,
            "runs": len(these),
            "live_set_same": sum(kill.is_live_same for kill in these),
            "other_sets_same": sum(kill.are_others_same for kill in these),
            "half_written": sum(kill.is_half_written for kill in these),
            "other_set_live_at_the_kill": sum(kill.was_other_set_live for kill in these),
            "until_proven_p50": times[len(times) // 2],
            "until_proven_max": times[-1],
        }
        rows.append(row)
    return rows

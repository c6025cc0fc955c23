"""How a flight ended, and why: the head of a report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from mkdaemon.reading import Sort
from mkdaemon.telemetry.tone import Tone
from mkdaemon.view.report.flight import RecordedFlight
from mkdaemon.view.report.troubles import Trouble

LISTED: Final = 20
"""Troubles of the head of a page."""
RELEASE: Final = "release"
"""The action of `event/failsafe` that ends a flight."""
AT_ONCE: Final = 1.0
"""A failsafe and the end of a flight that are closer together belong together [s]."""


class Head(NamedTuple):
    """What a report begins with.

    Attributes:
        text: how the flight ended.
        is_bad: a failsafe ended it.
        chain: why: times [s] and reasons, the effect first; then the troubles that it outlived.
        end: the worst that was known at the end of the recording, as every other screen says it.
        tone: how good that is.
    """

    text: str
    is_bad: bool
    chain: Sequence[tuple[float, str]]
    end: str = ""
    tone: Tone = Tone.NOTE


def head_of(flight: RecordedFlight) -> Head:
    """How a flight ended, and why."""
    return _head(flight)._replace(end=flight.end.headline, tone=flight.end.tone)


def _head(flight: RecordedFlight) -> Head:
    if not any(state.is_flown for state in flight.states):
        return Head("No automatic flight.", False, ())
    if flight.states[-1].is_flown:
        return Head("The recording ends in flight.", False, tuple(_outlived(flight.troubles)))
    end = next(after for after, before in pairwise(reversed(flight.states)) if before.is_flown)
    failed = any(
        one.sort is Sort.FAILSAFE and RELEASE in one.text.partition(":")[0] and abs(end.at - one.at) < AT_ONCE
        for one in flight.happenings
    )
    fatal = [one for one in flight.troubles if one.reported <= end.at <= one.ended + AT_ONCE]
    if not failed:
        outcome = f" ({end.outcome.replace('_', ' ')})" if end.outcome else ""
        return Head(f"Ended at {end.at:.1f} s: {end.reason}{outcome}.", False, tuple(_outlived(flight.troubles)))
    chain = [(reason.since, reason.text) for one in fatal[-1:] for reason in one.reasons.values()]
    outlived = _outlived([one for one in flight.troubles if one not in fatal[-1:]])
    return Head(f"FAILED at {end.at:.1f} s: {end.reason}.", True, (*chain, *outlived))


def _outlived(troubles: Sequence[Trouble]) -> Iterator[tuple[float, str]]:
    """A line for each trouble that a flight outlived, the longest first."""
    for one in sorted(troubles, key=lambda one: one.reported - one.ended)[:LISTED]:
        chain = "; ".join(reason.text for reason in one.reasons.values())
        yield min(reason.since for reason in one.reasons.values()), f"survived: {chain}; ended at {one.ended:.1f} s"

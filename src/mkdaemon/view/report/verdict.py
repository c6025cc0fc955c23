"""How a flight ended, and why: the head of a report; and the flight in a few sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from typing import Final, NamedTuple

from mkdaemon.reading import Sort
from mkdaemon.telemetry.tone import Tone
from mkdaemon.view.report.flight import RecordedFlight
from mkdaemon.view.report.happenings import Trouble, refusals
from mkdaemon.view.report.pieces import Piece, Settled

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


def moment(seconds: float) -> str:
    """A Unix time [s] as date and time, UTC."""
    try:
        return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    except (ValueError, OverflowError, OSError):
        return "an unknown time"


def flown_time(flight: RecordedFlight) -> float:
    """How long the machine steered [s]."""
    ends = [state.at for state in flight.states[1:]] + [flight.ended]
    return sum(max(end - state.at, 0.0) for state, end in zip(flight.states, ends, strict=False) if state.is_flown)


def sentences(flight: RecordedFlight, pieces: Sequence[Piece], began: float) -> list[str]:
    """What happened, in order of importance.

    Args:
        flight: what flew.
        pieces: of it.
        began: Unix time of the recording's beginning [s].
    """
    lines = [f"Recorded on {moment(began)}, {flight.ended - flight.began:.1f} s, {flight.entries} entries."]
    lines += _flown(flight, pieces)
    lines += _errors(pieces)
    return [*lines, *_failsafes(flight), *_refused(flight)]


def _flown(flight: RecordedFlight, pieces: Sequence[Piece]) -> list[str]:
    seconds = flown_time(flight)
    if not seconds:
        return []
    kinds: list[str] = []
    for piece in pieces:
        if not kinds or kinds[-1] != piece.manoeuvre:
            kinds.append(piece.manoeuvre)
    ways = f": {', '.join(kinds[:12])}{' ...' if len(kinds) > 12 else ''}" if kinds else ""
    return [f"Automatic flight for {seconds:.1f} s{ways}."]


def _errors(pieces: Sequence[Piece]) -> list[str]:
    if (found := Settled.of(pieces)) is None:
        return []
    return [
        f"Horizontal distance from its goals after arrival: {found.rms_cm:.1f} cm RMS, "
        f"{found.worst_cm:.1f} cm at most, in {found.worst.name} at {found.worst.begin:.1f} s{found.left_out}."
    ]


def _failsafes(flight: RecordedFlight) -> list[str]:
    found = [one for one in flight.happenings if one.sort is Sort.FAILSAFE]
    if not found:
        return ["No failsafe."]
    words = "A failsafe acted" if len(found) == 1 else f"{len(found)} failsafes acted, the first"
    first = found[0].text.removeprefix("FAILSAFE ")
    return [f"{words} at {found[0].at:.1f} s: {first}."]


def _refused(flight: RecordedFlight) -> list[str]:
    found = refusals(flight.happenings)
    if not found:
        return ["No refusals."]
    words = ", ".join(f"{one.count} {one.token or 'without a token'}" for one in found[:6])
    return [f"Refused: {words}."]

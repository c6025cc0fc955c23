"""A flight in a few sentences."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from mkdaemon.reading import Sort
from mkdaemon.view.report.flight import RecordedFlight
from mkdaemon.view.report.happenings import refusals
from mkdaemon.view.report.pieces import Piece, Settled


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

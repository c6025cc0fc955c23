"""A flight in a few sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime

from mkdaemon.reading import Sort
from mkdaemon.telemetry.link import fates_of
from mkdaemon.view.report.facts import shares
from mkdaemon.view.report.flight import Flight
from mkdaemon.view.report.happenings import refusals
from mkdaemon.view.report.pieces import Piece


def moment(seconds: float) -> str:
    """A Unix time [s] as date and time, UTC."""
    try:
        return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    except (ValueError, OverflowError, OSError):
        return "an unknown time"


def flown_time(flight: Flight) -> float:
    """How long the machine steered [s]."""
    ends = [state.at for state in flight.states[1:]] + [flight.ended]
    return sum(max(end - state.at, 0.0) for state, end in zip(flight.states, ends, strict=False) if state.is_flown)


def sentences(flight: Flight, pieces: Sequence[Piece], began: float) -> list[str]:
    """What happened, in order of importance.

    Args:
        flight: what flew.
        pieces: of it.
        began: Unix time of the recording's beginning [s].
    """
    lines = [f"Recorded on {moment(began)}, {flight.ended - flight.began:.1f} s, {flight.entries} entries."]
    lines += _flown(flight, pieces)
    lines += _errors(pieces)
    lines += [*_failsafes(flight), *_refused(flight), *_line(flight), *_eyes(flight), *_battery(flight)]
    return lines


def _flown(flight: Flight, pieces: Sequence[Piece]) -> list[str]:
    seconds = flown_time(flight)
    if not seconds:
        return []
    kinds: list[str] = []
    for piece in pieces:
        if not kinds or kinds[-1] != piece.manoeuvre:
            kinds.append(piece.manoeuvre)
    ways = f": {', '.join(kinds[:12])}{' ...' if len(kinds) > 12 else ''}" if kinds else ""
    return [f"The machine flew for {seconds:.1f} s{ways}."]


def _errors(pieces: Sequence[Piece]) -> list[str]:
    settled = [piece for piece in pieces if piece.errors is not None and not piece.stage]
    if not settled:
        return []
    count = sum(piece.errors.count for piece in settled if piece.errors)
    squares = sum(piece.errors.count * piece.errors.level_rms_cm**2 for piece in settled if piece.errors)
    worst = max(settled, key=lambda piece: piece.errors.level_max_cm if piece.errors else 0.0)
    farthest = worst.errors.level_max_cm if worst.errors else 0.0
    blind = sum(piece.blind for piece in pieces)
    return [
        f"Over its goals it was {math.sqrt(squares / count):.1f} cm off horizontally (RMS, once it was there), "
        f"{farthest:.1f} cm at most, in {worst.name} at {worst.begin:.1f} s{blind_words(blind)}."
    ]


def blind_words(seconds: float) -> str:
    """What figures of errors leave out; empty for nothing."""
    return f"; {seconds:.1f} s of blind flight are left out" if seconds else ""


def _failsafes(flight: Flight) -> list[str]:
    found = [one for one in flight.happenings if one.sort is Sort.FAILSAFE]
    if not found:
        return ["No failsafe acted."]
    words = "A failsafe acted" if len(found) == 1 else f"{len(found)} failsafes acted, the first"
    first = found[0].text.removeprefix("FAILSAFE ")
    return [f"{words} at {found[0].at:.1f} s: {first}."]


def _refused(flight: Flight) -> list[str]:
    found = refusals(flight.happenings)
    if not found:
        return ["Nothing was refused."]
    words = ", ".join(f"{one.count} {one.token or 'without a token'}" for one in found[:6])
    return [f"Refused: {words}."]


def _line(flight: Flight) -> list[str]:
    times = shares(flight.conditions, flight.ended)
    total = sum(times.values())
    if not total:
        return []
    trips = flight.series.get("link.echo_p95")
    words = f"The link was up for {100.0 * times.get('up', 0.0) / total:.0f} % of the time"
    if trips is not None:
        words += f", and p95 of the round trip was {max(trips.values):.0f} ms at worst"
    counted = fates_of(flight.last.get("link/health", {}))
    return [f"{words}.", *(f"{title.capitalize()}: {fates.words}." for title, fates in counted.items())]


def _eyes(flight: Flight) -> list[str]:
    lines = []
    for camera in flight.cameras:
        posed = flight.series.get(f"{camera} eyes.posed")
        if posed is not None:
            mean = sum(posed.values) / len(posed)
            lines.append(f"Camera {camera} gave a pose from {mean:.0f} % of its images on average.")
    return lines


def _battery(flight: Flight) -> list[str]:
    voltage = flight.series.get("battery.voltage")
    if voltage is None:
        return []
    _, volts = voltage.arrays()
    return [f"The battery went from {volts[0]:.1f} V to {volts[-1]:.1f} V, {volts.min():.1f} V at least."]

"""Figures of a flight as rows of two words: the link, vision, the battery, the manoeuvres, gaps of the recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from mkdaemon.errors import MkError
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import spell_value
from mkdaemon.reading.facts import UNKNOWN
from mkdaemon.record.layout import Session
from mkdaemon.record.summary import Summary
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.link import FATES
from mkdaemon.view.report.flight import RecordedFlight
from mkdaemon.view.report.said import number_of, part_of, short, text_of

Row = tuple[str, str]
MOST_ROWS: Final = 40
"""Of one table."""


def shares(conditions: list[tuple[float, str]], end: float) -> dict[str, float]:
    """How long each word held [s], until an end [s]."""
    found: dict[str, float] = {}
    ends = [at for at, _ in conditions[1:]] + [end]
    for (at, word), until in zip(conditions, ends, strict=False):  # no condition, no end
        found[word] = found.get(word, 0.0) + max(until - at, 0.0)
    return found


def at_end(flight: RecordedFlight, *words: str) -> list[Row]:
    """Facts of the end, in the words of every screen; what is not known is left out."""
    return [(fact.name, fact.aged) for fact in flight.end.facts if fact.id in words and fact.text != UNKNOWN]


def over_time(flight: RecordedFlight, names: Mapping[str, str], before: str = "") -> list[Row]:
    """How numbers went: the first and the last, and between what they were.

    Args:
        flight: has them.
        names: what a number is called and its unit, `voltage [V]`, by the name of its series.
        before: beginning of the names of series.
    """
    rows = []
    for name, title in names.items():
        if (series := flight.series.get(before + name)) is not None:
            _, numbers = series.arrays()
            span = f"{numbers.min():.1f} to {numbers.max():.1f}, on average {numbers.mean():.1f}"
            rows.append((title, f"{span}; first {numbers[0]:.1f}, last {numbers[-1]:.1f}"))
    return rows


def counted(fields: Mapping[str, Any], titles: Mapping[str, str]) -> list[Row]:
    """What was counted of a key, a number or one for each word; what is none is left out."""
    rows = []
    for name, title in titles.items():
        found = part_of(fields, name)
        words = [f"{short(word)}: {short(value)}" for word, value in found.items()] if isinstance(found, dict) else []
        if number := number_of(fields, name):
            words.append(f"{number:.0f}")
        if words:
            rows.append((title, short("; ".join(words))))
    return rows


def link_rows(flight: RecordedFlight) -> list[Row]:
    """How the line was."""
    times = shares(flight.conditions, flight.ended)
    rows = [("condition", ", ".join(f"{word} {seconds:.1f} s" for word, seconds in times.items())[:300])]
    rows += at_end(flight, "link", "port", "latency", "streams", *FATES)
    trips = {"link.echo_p95": "link test, p95 [ms]", "link.confirm_p95": "stick frames, p95 [ms]"}
    rows += over_time(flight, trips | {"link.echo_loss": "link test, lost [%]"})
    titles = {"rx_frames": "frames received", "tx_frames": "frames sent", "dropped": "dropped"}
    return rows[not times :] + counted(flight.newest("link/traffic"), titles)


def eyes_rows(flight: RecordedFlight, camera: str) -> list[Row]:
    """How a camera and its detector worked."""
    stats = flight.newest(f"vision/{camera}/stats")
    poses = flight.series.get(f"{camera} pose.x")
    latencies = {f"latency_{name}": f"latency, {name} [ms]" for name in ("p50", "p99")}
    images = {name: f"images {name}" for name in ("processed", "dropped", "lost", "damaged", "faults")}
    words = {"refused": "poses refused", "alarms": "alarms", "attitude_lost": "attitude not used"}
    return [
        *at_end(flight, f"eye-{camera}", f"sight-{camera}"),
        *over_time(flight, {"posed": "images with a pose [%]"} | latencies, f"{camera} eyes."),
        ("poses", str(0 if poses is None else len(poses))),
        *counted(stats, {"width": "width [px]", "height": "height [px]"} | images | words),
    ]


def battery_rows(flight: RecordedFlight) -> list[Row]:
    """What the flight took of the battery."""
    numbers = {"voltage": "voltage [V]", "current": "current [A]", "used_mah": "charge used [mAh]"}
    found = over_time(flight, numbers, "battery.")
    return [*at_end(flight, "battery"), *found] if found else []


def version_rows(flight: RecordedFlight, session: Session | None) -> list[Row]:
    """Programs and boards that flew."""
    recorded = [] if session is None else [("recorded by", f"{session.program} on {session.host} ({session.recorder})")]
    layout = text_of(flight.newest("link/state"), "external_control")
    rows = [
        *recorded,
        *at_end(flight, "vehicle", "firmware"),
        *([("layout of stick frames", layout)] if layout else []),
    ]
    rows += [(f"model: {short(name)}", f"{value:.5g}") for name, value in flight.model.items() if _is_number(value)]
    return rows[:MOST_ROWS]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def parameter_rows(flight: RecordedFlight) -> tuple[str, list[Row]]:
    """The active parameter set: its name, and its parameters; nothing where it was not read or is not known."""
    try:
        found = ParameterSet.from_payload(flight.parameters)
        rows = [(name, _spelled(spell_value(found, name))) for name in found.values() if name != "name"]
    except MkError:
        return "", []
    return found.name, rows


def _spelled(value: object) -> str:
    return ", ".join(map(str, value)) or "none" if isinstance(value, list) else str(value)


def configuration(session: Session | None) -> str:
    """The configuration as people read it; empty where the recording has none."""
    if session is None or not session.config:
        return ""
    try:
        return json.dumps(json.loads(session.config), indent=1, ensure_ascii=False)[:100_000]
    except (ValueError, RecursionError):
        return session.config[:100_000]


def losses(summary: Summary, flight: RecordedFlight) -> list[str]:
    """What the recording lacks, a sentence each; nothing where it is whole."""
    report = summary.report
    lines: list[str] = []
    if not report.is_complete:
        lines.append(
            "The recording is not finished: a crash or power failure cut it off, or it is still being written."
        )
    if report.damages:
        size = sum(one.length for one in report.damages)
        first = report.damages[0]
        lines.append(
            f"{len(report.damages)} damaged parts of the file, {size} bytes, cannot be read; the first at byte "
            f"{first.offset}: {short(first.reason)}."
        )
    if report.lost:
        gaps = sorted(report.gaps.items(), key=lambda gap: -gap[1])[:5]
        words = ", ".join(f"{number} of {short(key)}" for (_, key), number in gaps)
        lines.append(f"{report.lost} entries are missing, as their numbers show: {words}.")
    for number, words in (
        (report.unreadable, "entries cannot be unpacked"),
        (report.orphans, "entries belong to no channel of the file"),
        (summary.missed.total(), "values of the daemon did not reach the recorder"),
        (flight.left_out, "further events are not listed"),
    ):
        if number:
            lines.append(f"{number} {words}.")
    status = flight.newest("record/status")
    if number_of(status, "lost"):
        lines.append(
            f"The daemon's recorder lost {number_of(status, 'lost'):.0f} entries: the disk was too slow or full."
        )
    return lines


def seconds_of(summary: Summary) -> float:
    """Unix time of the beginning [s]."""
    return summary.first / NANOSECONDS

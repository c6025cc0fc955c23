"""Figures of a flight as rows of two words: the line, the eyes, the battery, what flew, what the recording lacks."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from mkdaemon.errors import MkError
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import spell_value
from mkdaemon.record.layout import Session
from mkdaemon.record.summary import Summary
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.link import fates_of
from mkdaemon.view.report.flight import Flight
from mkdaemon.view.report.said import number_of, part_of, short, text_of

Row = tuple[str, str]
MOST_ROWS: Final = 40
"""Of one table."""


def shown(value: float | None, unit: str, digits: int = 1) -> str:
    """A number with its unit; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f} {unit}".rstrip()


def shares(conditions: list[tuple[float, str]], end: float) -> dict[str, float]:
    """How long each word held [s], until an end [s]."""
    found: dict[str, float] = {}
    ends = [at for at, _ in conditions[1:]] + [end]
    for (at, word), until in zip(conditions, ends, strict=False):  # no condition, no end
        found[word] = found.get(word, 0.0) + max(until - at, 0.0)
    return found


def link_rows(flight: Flight) -> list[Row]:
    """How the line was."""
    health, traffic = flight.last.get("link/health", {}), flight.last.get("link/traffic", {})
    rows: list[Row] = []
    times = shares(flight.conditions, flight.ended)
    if times:
        rows.append(("condition", ", ".join(f"{word} {seconds:.1f} s" for word, seconds in times.items())[:300]))
    state = flight.last.get("link/state", part_of(health, "state") or {})
    if state:
        rows.append(("port", f"{text_of(state, 'port')}, {shown(number_of(state, 'baud'), 'baud', 0)}"))
    for name, title in (("echo", "link test"), ("confirm", "stick frames")):
        if number_of(health, f"{name}.sent_total"):
            trip = (number_of(health, f"{name}.{what}_ms") for what in ("p50", "p95", "p99"))
            rows.append((f"{title}, round trip at the end", _percentiles(*trip)))
    rows += [(title, fates.words) for title, fates in fates_of(health).items()]
    rows += [
        (title, f"{number_of(traffic, path):.0f}")
        for path, title in (("rx_frames", "frames received"), ("tx_frames", "frames sent"))
        if number_of(traffic, path)
    ]
    dropped = part_of(traffic, "dropped")
    if isinstance(dropped, Mapping) and dropped:
        words = ", ".join(f"{short(word)} {short(number)}" for word, number in dropped.items())
        rows.append(("dropped", short(words)))
    return rows


def _percentiles(p50: float | None, p95: float | None, p99: float | None) -> str:
    return f"p50 {shown(p50, 'ms')}, p95 {shown(p95, 'ms')}, p99 {shown(p99, 'ms')}"


def eyes_rows(flight: Flight, camera: str) -> list[Row]:
    """How a camera and its detector worked."""
    stats = flight.last.get(f"vision/{camera}/stats", {})
    rows: list[Row] = []
    if stats:
        rows = [
            ("state at the end", f"{text_of(stats, 'state')} {text_of(stats, 'reason')}".strip()),
            ("images", f"{shown(number_of(stats, 'processed'), 'looked at', 0)}, {_lost_images(stats)}"),
        ]
    width, height = number_of(stats, "width"), number_of(stats, "height")
    if width and height:
        rows.append(("size and rate", f"{width:.0f} x {height:.0f} px, {shown(number_of(stats, 'fps'), 'Hz')}"))
    posed = flight.series.get(f"{camera} eyes.posed")
    if posed is not None:
        rows.append(
            ("images with a pose", f"{np.mean(posed.values):.0f} % on average, {min(posed.values):.0f} % least")
        )
    poses = flight.series.get(f"{camera} pose.x")
    rows.append(("poses", str(0 if poses is None else len(poses))))
    for name, title in (("p50", "latency, median"), ("p99", "latency, 99th percentile")):
        found = flight.series.get(f"{camera} eyes.latency_{name}")
        if found is not None:
            middle, worst = float(np.median(found.values)), max(found.values)
            rows.append((title, f"{middle:.0f} ms as a rule, {worst:.0f} ms at worst"))
    for path, title in (("refused", "poses refused"), ("alarms", "alarms"), ("attitude_lost", "attitude not used")):
        found_words = part_of(stats, path)
        if isinstance(found_words, Mapping) and found_words:
            words = (f"{short(word)}: {short(value)}" for word, value in found_words.items())
            rows.append((title, short("; ".join(words))))
    return rows


def _lost_images(stats: Mapping[str, Any]) -> str:
    counts = {name: number_of(stats, name) or 0.0 for name in ("dropped", "lost", "damaged", "faults")}
    return ", ".join(f"{count:.0f} {name}" for name, count in counts.items())


def battery_rows(flight: Flight) -> list[Row]:
    """What the flight took of the battery."""
    voltage = flight.series.get("battery.voltage")
    if voltage is None:
        return []
    _, volts = voltage.arrays()
    rows: list[Row] = [
        ("voltage", f"{volts[0]:.2f} V at the beginning, {volts[-1]:.2f} V at the end, {volts.min():.2f} V least")
    ]
    cells = number_of(flight.last.get("health", {}), "battery_cells")
    if cells:
        rows.append(("cells", f"{cells:.0f}, {volts.min() / cells:.2f} V each at least"))
    for name, unit, title in (("current", "A", "current"), ("used_mah", "mAh", "charge used")):
        found = flight.series.get(f"battery.{name}")
        if found is not None:
            words = f"{found.values[-1] - found.values[0]:.0f} {unit}" if name == "used_mah" else ""
            rows.append(
                (title, words or f"{np.mean(found.values):.1f} A on average, {max(found.values):.1f} A at most")
            )
    return rows


def version_rows(flight: Flight, session: Session | None) -> list[Row]:
    """Programs and boards that flew."""
    rows: list[Row] = []
    if session is not None:
        rows += [("recorded by", f"{session.program} on {session.host} ({session.recorder})")]
    health = flight.last.get("health", {})
    firmware = part_of(health, "firmware")
    if isinstance(firmware, Mapping):
        rows += [(f"firmware of {short(board)}", short(release)) for board, release in firmware.items()]
    state = flight.last.get("link/state", {})
    for path, title in (("firmware", "boards"), ("external_control", "layout of stick frames")):
        if words := text_of(state, path):
            rows.append((title, words))
    if note := text_of(health, "note"):
        rows.append(("note", note))
    rows += [(f"model: {short(name)}", f"{value:.5g}") for name, value in flight.model.items() if _is_number(value)]
    return rows[:MOST_ROWS]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def parameter_rows(flight: Flight) -> tuple[str, list[Row]]:
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


def losses(summary: Summary, flight: Flight) -> list[str]:
    """What the recording lacks, a sentence each; nothing where it is whole."""
    report = summary.report
    lines: list[str] = []
    if not report.is_complete:
        lines.append(
            "The recording was not finished: a crash or a power failure cut it off, or it is still being made."
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
        lines.append(f"{report.lost} entries are missing by their numbers: {words}.")
    for number, words in (
        (report.unreadable, "entries cannot be unpacked"),
        (report.orphans, "entries belong to no channel of the file"),
        (summary.missed.total(), "values were put by the daemon and did not reach the recorder"),
        (flight.left_out, "further events are not listed"),
    ):
        if number:
            lines.append(f"{number} {words}.")
    status = flight.last.get("record/status", {})
    if number_of(status, "lost"):
        lines.append(
            f"The daemon's recorder lost {number_of(status, 'lost'):.0f} entries: the disk was too slow or full."
        )
    return lines


def seconds_of(summary: Summary) -> float:
    """Unix time of the beginning [s]."""
    return summary.first / NANOSECONDS

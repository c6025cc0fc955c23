"""The result of a replay, for people and for programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from mkdaemon.config.root import Config
from mkdaemon.record.entry import EntryKind
from mkdaemon.replay.compare import Comparison, KeyReport, compare
from mkdaemon.replay.recorded import read_recorded
from mkdaemon.replay.run import replay

_SIGHT: Final = "vision/"
_EDGES: Final = "tf"
_SHOWN: Final = 160
"""Longest value shown in text [characters]."""
_FIELDS: Final = 6
"""Fields shown in text; the JSON has all."""


@dataclass(frozen=True, slots=True)
class ReplayReport:
    """How today's code compares with a recording.

    Attributes:
        name: of the recording.
        program: that recorded it.
        seconds: its length.
        comparison: of every key.
        notes: what limits the comparison, in sentences.
    """

    name: str
    program: str
    seconds: float
    comparison: Comparison
    notes: tuple[str, ...]

    @property
    def is_equal(self) -> bool:
        """Whether there is no difference."""
        return self.comparison.differences == 0

    def as_map(self) -> dict[str, Any]:
        """For programs."""
        return {
            "recording": self.name,
            "program": self.program,
            "seconds": round(self.seconds, 3),
            "compared": self.comparison.compared,
            "differences": self.comparison.differences,
            "notes": list(self.notes),
            "keys": {key: _key_map(report) for key, report in self.comparison.keys.items()},
            "left_out": dict(self.comparison.left_out),
        }

    def lines(self) -> Iterator[str]:
        """For people."""
        comparison = self.comparison
        yield f"{self.name}, recorded by {self.program}: {self.seconds:.1f} s"
        yield from self.notes
        for report in comparison.keys.values():
            if report.differences:
                yield from _key_lines(report)
        left_out = sum(comparison.left_out.values())
        verdict = f"{comparison.differences} differences" if comparison.differences else "no difference"
        yield f"{comparison.compared} values of {len(comparison.keys)} keys compared, {left_out} left out: {verdict}"


def verify(paths: list[Path], cfg: Config | None = None) -> ReplayReport:
    """Run a recording through today's code and compare.

    Args:
        paths: the files of one black box, from its first part on.
        cfg: to fly with, in place of the recorded configuration.

    Raises:
        MkError: a file cannot be opened.
        ConfigError: the recording is none of a black box, not whole from its beginning on, or its configuration cannot
            work here.
    """
    recorded = read_recorded(paths)
    replayed = replay(recorded, cfg or recorded.config)
    notes = []
    if cfg is None and recorded.left_out:
        notes.append(f"left out of its configuration, as these keys are none today: {', '.join(recorded.left_out)}")
    without: frozenset[str] = frozenset()
    if not replayed.has_eyes and any(entry.suffix.startswith(_SIGHT) for entry in recorded.of(EntryKind.SAMPLE)):
        notes.append(
            "not every image was recorded: the recorded poses were flown with, vision/ and tf are not compared"
        )
        without = frozenset({_SIGHT, _EDGES})
    if recorded.lost or recorded.damaged:
        notes.append(
            f"{recorded.lost} entries are missing and {recorded.damaged} damaged: what follows from them may differ"
        )
    if recorded.stopped_at is None:
        notes.append("the daemon did not end in order: compared up to the last entry")
    return ReplayReport(
        recorded.session.name,
        recorded.session.program,
        recorded.end - recorded.start,
        compare(recorded, replayed.outputs, without=without),
        tuple(notes),
    )


def _key_map(report: KeyReport) -> dict[str, Any]:
    first = None if report.first is None else asdict(report.first)
    return {
        "recorded": report.recorded,
        "replayed": report.replayed,
        "differing": report.differing,
        "missing": report.missing,
        "new": report.new,
        "fields": report.fields,
        "first": first,
    }


def _key_lines(report: KeyReport) -> Iterator[str]:
    yield (
        f"{report.key}: {report.recorded} recorded, {report.replayed} replayed; "
        f"{report.differing} differ, {report.missing} missing, {report.new} new"
    )
    if report.fields:
        ranked = sorted(report.fields.items(), key=lambda pair: -pair[1])
        more = f", {len(ranked) - _FIELDS} more" if len(ranked) > _FIELDS else ""
        yield "    fields: " + ", ".join(f"{name} ({count})" for name, count in ranked[:_FIELDS]) + more
    first = report.first
    if first is not None:
        where = f"{first.field}: " if first.field else ""
        values = f"{_short(first.recorded)} recorded, {_short(first.replayed)} replayed"
        yield f"    first at {first.at:.3f} s: {where}{values}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
